// One case in full: why, its criteria and their course, delivery, timings, and how to run it again.

function choose(at) {
  byId("chosen").replaceChildren(caseBlock(at, true));
}

function caseBlock(at, open) {
  const name = CASES.case[at];
  const summary = el("summary", {}, el("span", { class: `word ${outcomeOf(at)}` }, outcomeOf(at)), name,
    el("small", {}, [quarantineOf(at) ? "in quarantine" : "", word(CASES.reason, at), valuesOf(at)].filter(Boolean).join(" · ")));
  const block = el("details", { class: "case", open, "data-case": name }, summary);
  const fill = () => { if (block.children.length === 1) block.append(...caseParts(at)); };
  if (open) fill();
  block.addEventListener("toggle", fill);
  block.fill = fill;
  return block;
}

function caseParts(at) {
  const name = CASES.case[at];
  const detail = Object.hasOwn(DATA.details, name) ? DATA.details[name] : null;
  const message = detail ? detail.message : word(CASES.message, at);
  const parts = [message ? el("p", {}, message) : null];
  if (quarantineOf(at)) parts.push(el("p", { class: "note" }, `This case is ${quarantineOf(at)}. It does not decide the verdict.`));
  parts.push(detail && detail.criteria.length ? findings(detail.criteria) : figuresOf(at));
  const discarded = detail ? detail.discarded : [word(CASES.discarded, at)].filter(Boolean);
  if (discarded.length) parts.push(el("h4", {}, "Runs that do not count"), el("pre", {}, discarded.join("\n")));
  if (detail) parts.push(...detailParts(detail));
  else if (CASES.outcome[at] !== "P") {
    parts.push(el("p", { class: "note" }, "Its ledger, timings and output are not in this page, which shows"
      + ` ${Object.keys(DATA.details).length} cases in full: they are in its line of results.jsonl.`));
  }
  parts.push(el("h4", {}, "Run this case again on a laptop"), command(replayCommand(name)));
  return parts.filter(Boolean);
}

function detailParts(detail) {
  const parts = detail.series.map((series) => el("div", {},
    el("h4", {}, `${series.criterion}: ${series.label}`), course(series)));
  if (detail.stderr.length) parts.push(el("h4", {}, "Last lines of the stack's stderr"), el("pre", {}, detail.stderr.join("\n")));
  if (detail.lost.length) parts.push(el("h4", {}, "Starts that were lost"), el("pre", {}, detail.lost.join("\n")));
  if (detail.ledger.length) {
    parts.push(el("h4", {}, "Delivery", el("small", {}, detail.strength ? ` proof: ${detail.strength}` : "")), ledgerTable(detail.ledger));
  }
  const machine = Object.entries(detail.machine.figures);
  if (detail.machine.message || machine.length) {
    parts.push(el("h4", {}, "The machine meanwhile"), detail.machine.message ? el("p", {}, detail.machine.message) : null,
      el("dl", { class: "facts" }, machine.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, figure(value, "s"))))));
  }
  const seconds = Object.entries(detail.timings);
  if (seconds.length) {
    parts.push(el("h4", {}, "Seconds of its parts"), el("dl", { class: "facts" },
      seconds.map(([part, value]) => el("div", {}, el("dt", {}, part), el("dd", {}, figure(value))))));
  }
  const window = detail.window ? `, ${figure((detail.window[2] - detail.window[1]) / 1e9)} s from ${figure(detail.window[1] / 1e9)}` : "";
  if (detail.bag) parts.push(el("h4", {}, "Source"), el("p", { class: "mono" }, detail.bag, window));
  return parts;
}

function plainTable(heads, lines) {
  return el("div", { class: "scroll" }, el("table", { class: "plain" },
    el("thead", {}, el("tr", {}, heads.map((name) => el("th", { scope: "col" }, name)))),
    el("tbody", {}, lines.map((cells) => el("tr", {}, cells.map((cell) => el("td", {}, cell)))))));
}

const findings = (criteria) => plainTable(["Criterion", "Outcome", "May be", "What was found", "Judged on"], criteria.map((finding) =>
  [finding.name, el("span", { class: `word ${finding.outcome}` }, finding.outcome), finding.limit, finding.message, finding.covered || "–"]));

function figuresOf(at) {
  const judged = DATA.criteria.filter((criterion) => criterion.outcomes[at] !== "-");
  if (judged.length === 0) return null;
  return plainTable(["Criterion", "Outcome", "May be", "Figure"], judged.map((criterion) => [criterion.name,
    el("span", { class: `word ${OUTCOMES[criterion.outcomes[at]]}` }, OUTCOMES[criterion.outcomes[at]]),
    criterion.limit, criterion.figures ? figure(criterion.figures[at], criterion.unit) : "–"]));
}

const ledgerTable = (lines) => plainTable(["Topic", "Sent", "Node", "Received", "Dropped", "Proof", "Queue"],
  lines.map((line) => [line.topic, figure(line.sent), line.node, figure(line.received), figure(line.dropped), line.strength || "–", figure(line.queue)]));

function course(series) {
  const width = 720, height = 150, left = 8, bottom = 18;
  if (series.points.length === 0) return el("p", { class: "note" }, "no value");
  const values = series.points.map((point) => point[1]).concat([series.low, series.high].filter((value) => value !== null));
  let low = Math.min(...values), high = Math.max(...values);
  if (low === high) { low -= 0.5; high += 0.5; }
  const end = Math.max(series.points[series.points.length - 1][0], 1e-9), begin = Math.min(0, series.points[0][0]);
  const x = (time) => left + (time - begin) / (end - begin) * (width - 2 * left);
  const y = (value) => 8 + (high - value) / (high - low) * (height - bottom - 16);
  const limits = [series.low, series.high].filter((value) => value !== null)
    .map((value) => svg("line", { class: "limit", x1: left, x2: width - left, y1: y(value), y2: y(value) }));
  const outside = series.points.filter(([, value]) =>
    (series.low !== null && value < series.low) || (series.high !== null && value > series.high));
  return svg("svg", { class: "course", viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${series.label}: ${figure(low)} to ${figure(high)}` },
    svg("line", { class: "axis", x1: left, x2: width - left, y1: height - bottom, y2: height - bottom }), limits,
    svg("polyline", { points: series.points.map(([time, value]) => `${x(time).toFixed(1)},${y(value).toFixed(1)}`).join(" ") }),
    outside.map(([time, value]) => svg("circle", { class: "out", cx: x(time).toFixed(1), cy: y(value).toFixed(1), r: 2 })),
    svg("text", { x: left, y: height - 5 }, `${figure(begin)} s`),
    svg("text", { x: width - left, y: height - 5, "text-anchor": "end" }, `${figure(end)} s`),
    svg("text", { x: left + 4, y: 16 }, figure(high, series.unit)),
    svg("text", { x: left + 4, y: height - bottom - 4 }, figure(low, series.unit)));
}

// For a POSIX shell: a word of any text stays one word.
const quoted = (text) => /^[\w./:@=+-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;

function replayCommand(name) {
  const volumes = DATA.replay.claims.map((claim) => ` --volume ${quoted(`${claim}=FOLDER`)}`).join("");
  return `bagpipe replay ${quoted(name)} --results ${quoted(DATA.replay.results)}${volumes}`;
}

function command(text) {
  const block = el("pre", {}, text);
  const button = el("button", {
    type: "button",
    onclick: () => {
      const range = document.createRange();
      range.selectNodeContents(block);
      getSelection().removeAllRanges();
      getSelection().addRange(range);
      if (document.execCommand("copy")) button.textContent = "Copied";
    },
  }, "Copy");
  return el("div", { class: "command" }, block, button);
}

function failingCases() {
  const names = Object.keys(DATA.details);
  if (names.length === 0) return;
  byId("failing").hidden = false;
  const numbers = new Map(CASES.case.map((name, at) => [name, at]));
  const others = [...CASES.outcome].filter((letter) => letter !== "P").length;
  byId("failing-note").textContent = others > names.length
    ? `${names.length} of ${others.toLocaleString("en-US")} cases that did not pass, some of each kind of trouble. The table above has all.`
    : `All ${others} cases that did not pass.`;
  const blocks = names.filter((name) => numbers.has(name)).map((name, place) => caseBlock(numbers.get(name), place === 0));
  byId("failing-cases").append(...blocks);
  window.addEventListener("beforeprint", () => { for (const block of blocks) { block.fill(); block.open = true; } });
}
