// The job's data: columns over all cases, as report/columns.py makes them.

const DATA = JSON.parse(byId("data").textContent);
const CASES = DATA.cases;
const COUNT = CASES.case.length;
const OUTCOMES = { P: "passed", F: "failed", I: "invalid", E: "errored", "-": "not judged" };
// The worst outcome of a field of the heat map is the first of these that it has.
const WORST_FIRST = ["F", "E", "I", "P"];

const word = (column, at) => column.values[column.at[at]];
// Until when and why a case does not count; empty for one that does.
const quarantineOf = (at) => word(CASES.quarantine, at);
const outcomeOf = (at) => OUTCOMES[CASES.outcome[at]];

// What cases can be distinguished by: the matrix' variables first, then what every job has.
const DIMENSIONS = [
  ...DATA.variables,
  ...["variant", "fragment", "seed", "round"].map((name) => ({ name, ...CASES[name] })),
].filter((dimension) => dimension.values.length > 1);

const VARIANTS = CASES.variant.values;

function valuesOf(at) {
  return DATA.variables
    .filter((variable) => word(variable, at) !== null)
    .map((variable) => `${variable.name}=${asText(word(variable, at))}`)
    .join(" ");
}

// What the search looks at, once for all.
const HAYSTACK = CASES.case.map((name, at) =>
  [name, word(CASES.fragment, at), word(CASES.reason, at), word(CASES.message, at), quarantineOf(at), valuesOf(at)]
    .join("\n").toLowerCase());

// Order of a dimension's values: numbers by size, everything else as it came.
function ordered(dimension) {
  const numbers = dimension.values.map((_, number) => number);
  if (dimension.values.every((value) => typeof value === "number")) {
    numbers.sort((a, b) => dimension.values[a] - dimension.values[b]);
  }
  return numbers;
}
