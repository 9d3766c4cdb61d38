// The controls, and the order in which the page is drawn.

function option(value, text) { return el("option", { value }, text); }

function controls() {
  const search = el("input", {
    type: "search", id: "search", placeholder: "Search names, values, messages", "aria-label": "Search the cases",
    oninput: (event) => setFilters({ text: event.target.value }),
  });
  const outcome = el("select", { id: "outcome", "aria-label": "Outcome", onchange: (e) => setFilters({ outcome: e.target.value }) },
    option("", "every outcome"), WORST_FIRST.filter((letter) => CASES.outcome.includes(letter)).map((letter) => option(letter, OUTCOMES[letter])));
  const variant = el("select", { id: "variant", "aria-label": "Variant", onchange: (e) => setFilters({ variant: e.target.value }) },
    option("", "every variant"), VARIANTS.map((name, number) => option(number, name)));
  const criterion = el("select", { id: "criterion", "aria-label": "Criterion", onchange: (e) => setFilters({ criterion: e.target.value, criterionOutcome: e.target.value === "" ? "" : "F" }) },
    option("", "every criterion"), DATA.criteria.map((each, number) => option(number, `${each.name} failed`)));
  const clear = el("button", { type: "button", id: "clear", onclick: clearFilters }, "Show all");
  const chips = el("span", { id: "chips" });
  variant.hidden = VARIANTS.length < 2;
  criterion.hidden = DATA.criteria.length === 0;
  byId("case-controls").append(search, outcome, variant, criterion, chips, clear);
  onFilters(() => {
    if (search.value !== filters.text) search.value = filters.text;
    outcome.value = filters.outcome;
    variant.value = filters.variant;
    criterion.value = filters.criterion;
    const fields = [...filters.fields].map(([dimension, value]) =>
      el("span", { class: "chip word" }, `${DIMENSIONS[dimension].name}: ${asText(DIMENSIONS[dimension].values[value])}`));
    if (filters.criterionOutcome && filters.criterionOutcome !== "F") {
      fields.push(el("span", { class: "chip word" }, `criterion ${OUTCOMES[filters.criterionOutcome]}`));
    }
    if (filters.cause !== "") fields.push(el("span", { class: "chip word" }, `cause: ${DATA.causes.groups[filters.cause].reason}`));
    chips.replaceChildren(...fields);
    clear.hidden = matching.length === COUNT;
  });
  clear.hidden = true;
}

function theme() {
  const button = byId("theme"), root = document.documentElement;
  const isDark = () => root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const label = () => { button.textContent = isDark() ? "Light" : "Dark"; };
  button.hidden = false;
  button.addEventListener("click", () => { root.dataset.theme = isDark() ? "light" : "dark"; label(); });
  label();
}

function timings() {
  const values = CASES.seconds.filter((value) => value !== null);
  if (values.length === 0) return;
  let low = Infinity, high = -Infinity;
  for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
  const scale = low === high ? { low: low - 0.5, high: high + 0.5 } : { low, high };
  byId("timings").append(el("figure", {}, histogram(values, scale, { low: null, high: null }),
    el("figcaption", { class: "note" }, `Seconds of a case: median ${figure(median(values))}, longest ${figure(high)}`)));
}

function links() {
  for (const bar of document.querySelectorAll(".bar i")) bar.style.flexGrow = bar.dataset.grow;
  for (const link of document.querySelectorAll("a[data-case]")) {
    link.addEventListener("click", () => {
      clearFilters();
      setFilters({ text: link.dataset.case });
      const at = CASES.case.indexOf(link.dataset.case);
      if (at >= 0) choose(at);
    });
  }
  for (const link of document.querySelectorAll("nav a")) {
    const part = byId(link.getAttribute("href").slice(1));
    link.hidden = !part || part.hidden;
  }
}

theme();
controls();
heatMap();
criteriaTable();
caseTable();
failingCases();
causesTable();
timings();
links();
