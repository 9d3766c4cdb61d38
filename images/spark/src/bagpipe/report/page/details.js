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
  if (detail) parts.push(charts(name, detail), ...(cameras(detail) || []), ...detailParts(detail));
  else parts.push(...inShort(at));
  parts.push(el("h4", {}, "Look at this case, or run it again, on a laptop"), command(verbCommand("open", name)), command(verbCommand("replay", name)));
  return parts.filter(Boolean);
}

// Of a case that is not in full: what the table's columns know of it.
function inShort(at) {
  const facts = [["messages sent", CASES.sent[at]], ["processed", CASES.received[at]], ["dropped", CASES.dropped[at]]]
    .filter(([, value]) => value !== null);
  const parts = Object.entries(DATA.timings).map(([part, seconds]) => [part, seconds[at]]).filter(([, value]) => value !== null);
  const count = Object.keys(DATA.details).length.toLocaleString("en-US");
  return [
    facts.length ? [el("h4", {}, "Delivery"), factList(facts)] : null,
    parts.length ? [el("h4", {}, "Seconds of its parts"), factList(parts)] : null,
    el("p", { class: "note" }, `Its courses, ledger by node and output are not in this page, which has ${count} of ${DATA.counted.toLocaleString("en-US")} cases in full:`
      + " first those that did not pass, then those that changed, then a sample of those that passed. They are in its line of results.jsonl."),
  ].flat(Infinity);
}

const factList = (facts) => el("dl", { class: "facts" },
  facts.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, figure(value)))));

function detailParts(detail) {
  const parts = [];
  if (detail.left) parts.push(el("p", { class: "note" }, `${detail.left} more courses are left out here for size: its line of results.jsonl has them.`));
  if (detail.stderr.length) parts.push(el("h4", {}, "Last lines of the stack's stderr"), el("pre", {}, detail.stderr.join("\n")));
  if (detail.lost.length) parts.push(el("h4", {}, "Starts that were lost"), el("pre", {}, detail.lost.join("\n")));
  if (detail.ledger.length || detail.notes.length) {
    parts.push(el("h4", {}, "Delivery", el("small", {}, detail.strength ? ` proof: ${detail.strength}` : "")),
      ledgerTable(detail.ledger), ...detail.notes.map((note) => el("p", { class: "note" }, note)));
  }
  const machine = Object.entries(detail.machine.figures);
  if (detail.machine.message || machine.length) {
    parts.push(el("h4", {}, "The machine meanwhile"), detail.machine.message ? el("p", {}, detail.machine.message) : null,
      el("dl", { class: "facts" }, machine.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, figure(value, "s"))))));
  }
  const seconds = Object.entries(detail.timings);
  if (seconds.length) parts.push(el("h4", {}, "Seconds of its parts"), factList(seconds));
  const window = detail.window ? `, ${figure((detail.window[2] - detail.window[1]) / 1e9)} s from ${figure(detail.window[1] / 1e9)}` : "";
  if (detail.bag) parts.push(el("h4", {}, "Source"), el("p", { class: "mono" }, detail.bag, window));
  if (detail.recorded.length) parts.push(el("h4", {}, "What was recorded", el("small", {}, ` below ${DATA.replay.results}`)), recordings(detail.recorded));
  return parts;
}

// What was recorded in the case, as a link where its name can be one: the page lies in the same folder.
function recordings(names) {
  return el("p", { class: "mono" }, names.map((name) => el("span", { class: "recorded" },
    /^cases\/[A-Za-z0-9_+@=-][A-Za-z0-9._+@=-]*$/.test(name)
      ? el("a", { href: name.split("/").map(encodeURIComponent).join("/"), download: true }, name) : name, " ")));
}

function plainTable(heads, lines) {
  return el("div", { class: "scroll" }, el("table", { class: "plain" },
    el("thead", {}, el("tr", {}, heads.map((name) => el("th", { scope: "col" }, name)))),
    el("tbody", {}, lines.map((cells) => el("tr", {}, cells.map((cell) => el("td", {}, cell)))))));
}

const findings = (criteria) => plainTable(["Criterion", "Outcome", "May be", "What was found", "Judged on"], criteria.map((finding) =>
  [finding.name, el("span", { class: `word ${finding.outcome}` }, finding.outcome), finding.limit,
    [finding.message, finding.figures ? el("small", {}, ` All figures: ${finding.figures}.`) : null], finding.covered || "–"]));

function figuresOf(at) {
  const judged = DATA.criteria.filter((criterion) => criterion.outcomes[at] !== "-");
  if (judged.length === 0) return null;
  return plainTable(["Criterion", "Outcome", "May be", "Figure"], judged.map((criterion) => [criterion.name,
    el("span", { class: `word ${OUTCOMES[criterion.outcomes[at]]}` }, OUTCOMES[criterion.outcomes[at]]),
    limitsOf(criterion), [criterion, ...criterion.others].map((each) => each.figures ? figure(each.figures[at], each.unit) : "–").join("; ")]));
}

const ledgerTable = (lines) => plainTable(["Topic", "Sent", "Node", "Received", "Dropped", "Proof", "Queue"],
  lines.map((line) => [line.topic, figure(line.sent), line.node, figure(line.received), figure(line.dropped), line.strength || "–", figure(line.queue)]));

// For a POSIX shell: a word of any text stays one word.
const quoted = (text) => /^[\w./:@=+-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;

function verbCommand(verb, name) {
  const volumes = DATA.replay.claims.map((claim) => ` --volume ${quoted(`${claim}=FOLDER`)}`).join("");
  return `bagpipe ${verb} ${quoted(name)} --results ${quoted(DATA.replay.results)}${volumes}`;
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
  const names = DATA.listed;
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
