// Criteria: how often each held, and how its figures are spread, for each variant.

const BINS = 28;

function criteriaTable() {
  if (DATA.criteria.length === 0) return;
  byId("criteria").hidden = false;
  const head = el("tr", {}, ["Criterion", "May be", "Cases", "Figures"].map((name) => el("th", { scope: "col" }, name)));
  const lines = DATA.criteria.map((criterion, number) => el("tr", {},
    el("th", { scope: "row" }, criterion.name, " ", el("small", {}, criterion.kind)),
    el("td", {}, limitsOf(criterion)),
    el("td", {}, ["F", "I", "P"].map((letter) => countButton(criterion, number, letter))),
    el("td", {}, [criterion, ...criterion.others].map(histograms))));
  byId("criteria-table").append(el("table", { class: "plain" }, el("thead", {}, head), el("tbody", {}, lines)));
}

const limitsOf = (criterion) => [criterion, ...criterion.others].map((each) => each.limit).filter(Boolean).join("; ") || "–";

function countButton(criterion, number, letter) {
  const count = criterion.outcomes.split(letter).length - 1;
  if (count === 0) return null;
  return [el("button", {
    type: "button", class: `chip word ${OUTCOMES[letter]}`,
    onclick: () => { setFilters({ criterion: String(number), criterionOutcome: letter }); byId("cases").scrollIntoView(); },
  }, `${count.toLocaleString("en-US")} ${OUTCOMES[letter]}`), " "];
}

function histograms(criterion) {
  if (!criterion.figures) return el("small", {}, "Left out here for size: results.parquet has all figures.");
  const all = criterion.figures.filter((value) => value !== null);
  if (all.length === 0) return el("small", {}, "no figure");
  const limits = [criterion.low, criterion.high].filter((value) => value !== null);
  // Without spreading the argument list: there may be tens of thousands of figures.
  const scale = { low: Infinity, high: -Infinity };
  for (const value of [...all, ...limits]) {
    scale.low = Math.min(scale.low, value);
    scale.high = Math.max(scale.high, value);
  }
  if (scale.low === scale.high) { scale.low -= 0.5; scale.high += 0.5; }
  return el("div", { class: "histograms" }, VARIANTS.map((name, number) => {
    const values = criterion.figures.filter((value, at) => value !== null && CASES.variant.at[at] === number);
    if (values.length === 0) return null;
    return el("figure", {}, histogram(values, scale, criterion),
      el("figcaption", {}, `${VARIANTS.length > 1 ? `${name}: ` : ""}median ${figure(median(values), criterion.unit)}`));
  }));
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[Math.floor((sorted.length - 1) / 2)];
}

function histogram(values, scale, criterion) {
  const width = 210, height = 40, span = scale.high - scale.low;
  const bins = new Array(BINS).fill(0);
  for (const value of values) bins[Math.min(BINS - 1, Math.floor((value - scale.low) / span * BINS))] += 1;
  const most = Math.max(...bins), step = width / BINS;
  const outside = (bin) => {
    const first = scale.low + bin * span / BINS, last = first + span / BINS;
    return (criterion.low !== null && last <= criterion.low) || (criterion.high !== null && first >= criterion.high);
  };
  const bars = bins.map((count, bin) => count && svg("rect", {
    x: bin * step + 0.5, width: step - 1, y: height - Math.max(1.5, count / most * (height - 2)),
    height: Math.max(1.5, count / most * (height - 2)), class: outside(bin) ? "out" : null,
  }));
  const lines = [criterion.low, criterion.high].filter((value) => value !== null && value !== undefined).map((value) => {
    const x = (value - scale.low) / span * width;
    return svg("line", { class: "limit", x1: x, x2: x, y1: 0, y2: height });
  });
  return svg("svg", {
    class: "histogram", viewBox: `0 0 ${width} 56`, role: "img",
    "aria-label": `${values.length} figures from ${figure(scale.low)} to ${figure(scale.high)}`,
  }, bars.filter(Boolean), svg("line", { class: "base", x1: 0, x2: width, y1: height, y2: height }), lines,
  svg("text", { x: 0, y: 52 }, figure(scale.low)),
  svg("text", { x: width, y: 52, "text-anchor": "end" }, figure(scale.high)));
}
