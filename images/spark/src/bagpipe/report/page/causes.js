// Why cases did not pass: one line for each cause, and in full the case that is to be looked at first.

function causesTable() {
  const groups = DATA.causes.groups;
  if (groups.length === 0) return;
  byId("causes").hidden = false;
  const lines = groups.map((group, number) => [
    el("button", {
      type: "button", class: `chip word ${group.outcome}`,
      onclick: () => { setFilters({ cause: number }); byId("cases").scrollIntoView(); },
    }, `${group.count.toLocaleString("en-US")} ${group.outcome}`),
    group.reason, group.criteria.join(", ") || "–", group.message || "–",
    el("button", { type: "button", class: "link", onclick: () => show(group.first) }, group.first),
  ]);
  byId("causes-table").append(plainTable(["Cases", "Reason", "Criteria", "Message of the first, and alike", "First case"], lines));
  firstCase();
}

function show(name) {
  const at = CASES.case.indexOf(name);
  if (at < 0) return;
  clearFilters();
  setFilters({ text: name });
  choose(at);
  byId("chosen").scrollIntoView();
}

// What regressed comes first: it is what the change under test has done.
function firstCase() {
  const regressed = DATA.regressed.find((name) => CASES.case.includes(name));
  // What is in quarantine is known already.
  const counts = DATA.listed.find((each) => !quarantineOf(CASES.case.indexOf(each)));
  const name = regressed || counts || DATA.listed[0];
  if (!name || !CASES.case.includes(name)) return;
  byId("first-name").textContent = regressed ? "The first case that regressed" : "The first case that did not pass";
  byId("first-case").append(caseBlock(CASES.case.indexOf(name), true));
}
