// The matrix: two dimensions, a field for each pair of values, coloured by its worst outcome.

const MOST_LINES = 200;
const MOST_COLUMNS = 60;

function heatMap() {
  const usable = DIMENSIONS.map((dimension, number) => [dimension, number])
    .filter(([dimension]) => dimension.values.length <= MOST_LINES);
  if (usable.length === 0) return;
  byId("matrix").hidden = false;
  const [rows, columns] = [byId("rows"), byId("columns")];
  for (const [dimension, number] of usable) {
    rows.append(el("option", { value: number }, dimension.name));
    if (dimension.values.length <= MOST_COLUMNS) columns.append(el("option", { value: number }, dimension.name));
  }
  columns.append(el("option", { value: "" }, "(outcome only)"));
  rows.value = usable[0][1];
  columns.selectedIndex = columns.options[0].value === rows.value && columns.options.length > 2 ? 1 : 0;
  if (columns.value === rows.value) columns.value = "";
  const draw = () => drawHeat(Number(rows.value), columns.value === rows.value ? "" : columns.value);
  const restart = () => { setFilters({ fields: new Map() }); draw(); };
  rows.addEventListener("change", restart);
  columns.addEventListener("change", restart);
  onFilters(() => markHeat());
  draw();
}

function counted(row, column) {
  const fields = new Map();
  for (let at = 0; at < COUNT; at++) {
    const key = `${row.at[at]} ${column ? column.at[at] : 0}`;
    if (!fields.has(key)) fields.set(key, { P: 0, F: 0, I: 0, E: 0 });
    fields.get(key)[CASES.outcome[at]] += 1;
  }
  return fields;
}

function drawHeat(rowNumber, columnChoice) {
  const row = DIMENSIONS[rowNumber];
  const column = columnChoice === "" ? null : DIMENSIONS[Number(columnChoice)];
  const fields = counted(row, column);
  const across = column ? ordered(column) : [0];
  const head = el("tr", {}, el("td", {}), across.map((value) =>
    el("th", { scope: "col" }, column ? asText(column.values[value]) : "all cases")));
  const lines = ordered(row).map((value) => el("tr", {},
    el("th", { scope: "row" }, asText(row.values[value])),
    across.map((other) => el("td", {}, field(fields.get(`${value} ${other}`), {
      rowNumber, row, value, columnNumber: column ? Number(columnChoice) : null, column, other,
    })))));
  const caption = el("caption", { class: "note" }, column ? `${row.name} (down) and ${column.name} (across)` : row.name);
  byId("heat").replaceChildren(el("table", { class: "heat" }, caption, el("thead", {}, head), el("tbody", {}, lines)));
}

function field(counts, place) {
  if (!counts) return el("div", { class: "empty", title: "no such case" });
  const all = counts.P + counts.F + counts.I + counts.E;
  const worst = OUTCOMES[WORST_FIRST.find((letter) => counts[letter] > 0)];
  const named = `${place.row.name} ${asText(place.row.values[place.value])}`
    + (place.column ? `, ${place.column.name} ${asText(place.column.values[place.other])}` : "");
  const countsText = WORST_FIRST.filter((letter) => counts[letter]).map((letter) => `${counts[letter]} ${OUTCOMES[letter]}`).join(", ");
  const wanted = new Map([[place.rowNumber, place.value]]);
  if (place.column) wanted.set(place.columnNumber, place.other);
  return el("button", {
    type: "button", class: 2 * counts.P < all ? `${worst} mostly` : worst, "aria-pressed": "false", "aria-label": `${named}: ${countsText}`, title: `${named}: ${countsText}`,
    "data-field": [...wanted].join(";"),
    onclick: (event) => {
      const pressed = event.currentTarget.getAttribute("aria-pressed") === "true";
      setFilters({ fields: pressed ? new Map() : wanted });
    },
  }, all === counts.P ? `✓ ${all}` : `${mark(worst)} ${all - counts.P}/${all}`);
}

const mark = (outcome) => ({ failed: "✕", invalid: "?", errored: "!" })[outcome] || "✓";

function markHeat() {
  const chosen = [...filters.fields].join(";");
  for (const button of byId("heat").querySelectorAll("button")) {
    button.setAttribute("aria-pressed", String(chosen !== "" && button.dataset.field === chosen));
  }
}
