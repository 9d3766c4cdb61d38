// Which cases are shown. Every part of the page sets filters here and is notified of changes.

const filters = { text: "", outcome: "", variant: "", criterion: "", criterionOutcome: "", cause: "", fields: new Map() };
const listeners = [];
let matching = CASES.case.map((_, at) => at);

function matches(at, words) {
  if (filters.outcome && CASES.outcome[at] !== filters.outcome) return false;
  if (filters.variant !== "" && CASES.variant.at[at] !== Number(filters.variant)) return false;
  if (filters.cause !== "" && DATA.causes.at[at] !== filters.cause) return false;
  if (filters.criterion !== "") {
    const outcome = DATA.criteria[filters.criterion].outcomes[at];
    if (filters.criterionOutcome ? outcome !== filters.criterionOutcome : outcome === "-") return false;
  }
  for (const [dimension, value] of filters.fields) {
    if (DIMENSIONS[dimension].at[at] !== value) return false;
  }
  return words.every((wanted) => HAYSTACK[at].includes(wanted));
}

function setFilters(changed) {
  Object.assign(filters, changed);
  const words = filters.text.toLowerCase().split(/\s+/).filter(Boolean);
  matching = [];
  for (let at = 0; at < COUNT; at++) if (matches(at, words)) matching.push(at);
  for (const listener of listeners) listener();
}

const onFilters = (listener) => listeners.push(listener);
const clearFilters = () => setFilters({
  text: "", outcome: "", variant: "", criterion: "", criterionOutcome: "", cause: "", fields: new Map(),
});
