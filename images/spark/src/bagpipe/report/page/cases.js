// The table of all cases: only the lines in sight are in the page, so that 10,000 stay quick.

const LINE = 34;
const BEYOND = 12;
const MOST_PRINTED = 300;
let sorting = { key: "outcome", down: false };
let order = [];
let active = -1;

const SORTS = {
  case: (a, b) => a - b,
  outcome: (a, b) => WORST_FIRST.indexOf(CASES.outcome[a]) - WORST_FIRST.indexOf(CASES.outcome[b]),
  variant: (a, b) => CASES.variant.at[a] - CASES.variant.at[b],
  why: (a, b) => CASES.message.at[a] - CASES.message.at[b],
  seconds: (a, b) => (CASES.seconds[a] || 0) - (CASES.seconds[b] || 0),
  attempts: (a, b) => CASES.attempts[a] - CASES.attempts[b],
};

const columnsOfCases = () => [
  ["case", "Case", "minmax(180px, 2.2fr)"],
  ["outcome", "Outcome", "110px"],
  VARIANTS.length > 1 ? ["variant", "Variant", "minmax(90px, .8fr)"] : null,
  DATA.variables.length ? ["values", "Values", "minmax(120px, 1.6fr)"] : null,
  ["why", "Why", "minmax(140px, 2.4fr)"],
  ["seconds", "Seconds", "92px"],
  ["attempts", "Tries", "74px"],
].filter(Boolean);

function cellOf(key, at) {
  if (key === "case") return el("span", { role: "cell", title: CASES.case[at] }, CASES.case[at]);
  if (key === "outcome") return el("span", { role: "cell" }, el("span", { class: `word ${outcomeOf(at)}` }, outcomeOf(at)));
  if (key === "variant") return el("span", { role: "cell" }, word(CASES.variant, at));
  if (key === "values") return el("span", { role: "cell", title: valuesOf(at) }, valuesOf(at));
  if (key === "seconds") return el("span", { role: "cell", class: "n" }, figure(CASES.seconds[at]));
  if (key === "attempts") return el("span", { role: "cell", class: "n" }, CASES.attempts[at]);
  const why = [quarantineOf(at), word(CASES.message, at) || word(CASES.reason, at)].filter(Boolean).join("; ");
  return el("span", { role: "cell", title: why }, why);
}

function caseTable() {
  const columns = columnsOfCases();
  const head = el("div", { class: "row head", role: "row" }, columns.map(([key, name]) =>
    el("span", { role: "columnheader", "data-key": key, class: key === "seconds" || key === "attempts" ? "n" : null },
      SORTS[key] ? el("button", { type: "button", onclick: () => sortBy(key) }, name) : name)));
  const space = el("div", { class: "space", role: "rowgroup" });
  const body = el("div", { class: "body", tabindex: "0", "aria-label": "Cases: arrow keys choose, Enter opens" }, space);
  const grid = el("div", { class: "grid", role: "table", "aria-label": "Cases" }, head, body);
  grid.style.setProperty("--columns", columns.map(([, , width]) => width).join(" "));
  byId("case-table").append(grid);

  const draw = (everything) => {
    const first = everything ? 0 : Math.max(0, Math.floor(body.scrollTop / LINE) - BEYOND);
    const last = everything ? Math.min(order.length, MOST_PRINTED)
      : Math.min(order.length, Math.ceil((body.scrollTop + body.clientHeight) / LINE) + BEYOND);
    const lines = [];
    for (let place = first; place < last; place++) {
      const at = order[place];
      const line = el("div", {
        class: place === active ? "row active" : "row", role: "row", "aria-rowindex": place + 2, "data-at": at,
        onclick: () => { active = place; draw(); choose(at); },
      }, columns.map(([key]) => cellOf(key, at)));
      line.style.transform = `translateY(${place * LINE}px)`;
      lines.push(line);
    }
    space.style.height = `${order.length * LINE}px`;
    grid.setAttribute("aria-rowcount", String(order.length + 1));
    space.replaceChildren(...lines);
  };
  const renew = () => {
    order = [...matching];
    const compare = SORTS[sorting.key];
    order.sort((a, b) => (sorting.down ? compare(b, a) : compare(a, b)) || a - b);
    active = -1;
    body.scrollTop = 0;
    for (const header of head.children) {
      header.setAttribute("aria-sort", header.dataset.key !== sorting.key ? "none" : sorting.down ? "descending" : "ascending");
    }
    byId("found").textContent = `${order.length.toLocaleString("en-US")} of ${COUNT.toLocaleString("en-US")} cases`
      + (DATA.counted > COUNT ? ` (the job had ${DATA.counted.toLocaleString("en-US")}: some that passed are left out here; results.jsonl has all)` : "");
    draw();
  };
  const sortBy = (key) => {
    sorting = { key, down: sorting.key === key && !sorting.down };
    renew();
  };
  body.addEventListener("scroll", () => draw(), { passive: true });
  body.addEventListener("keydown", (event) => {
    const page = Math.floor(body.clientHeight / LINE) - 1;
    const step = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -COUNT, End: COUNT }[event.key];
    if (event.key === "Enter" && active >= 0) choose(order[active]);
    if (step === undefined || order.length === 0) return;
    event.preventDefault();
    active = Math.max(0, Math.min(order.length - 1, active + step));
    const top = active * LINE;
    if (top < body.scrollTop) body.scrollTop = top;
    if (top + LINE > body.scrollTop + body.clientHeight) body.scrollTop = top + LINE - body.clientHeight;
    draw();
  });
  window.addEventListener("beforeprint", () => draw(true));
  window.addEventListener("afterprint", () => draw());
  window.addEventListener("resize", () => draw());
  onFilters(renew);
  renew();
}
