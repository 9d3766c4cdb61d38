// The courses of a case's criteria below each other, with their bounds, the baseline's course, the moment
// at which each left its bounds, and what was written then. One cursor goes through all of them.

function charts(name, detail) {
  const baseline = baselineOf(name), lines = detail.lines || [];
  if (detail.series.length === 0 && lines.length === 0) return null;
  const axis = timeAxis(detail.series, detail.window, lines);
  const drawn = detail.series.flatMap((series) => [chart(series, axis, baseline), plane(series, baseline)]).filter(Boolean);
  const lane = lines.length ? logLane(lines, axis) : null;
  const time = el("b", { class: "time" }, "");
  const group = el("div", { class: "charts", tabindex: "0", role: "group", "aria-label": "Courses over time: arrow keys move the time that is read" },
    legend(detail, baseline, axis, time), drawn.map((each) => each.node), lane ? lane.node : null,
    el("p", { class: "axis note" }, el("span", {}, `${figure(axis.begin)} s`),
      el("span", {}, "seconds after the window's start"), el("span", {}, `${figure(axis.end)} s`)));
  cursor(group, axis, (at) => {
    time.textContent = at === null ? "" : `at ${at.toFixed(3)} s`;
    for (const each of [...drawn, lane].filter(Boolean)) each.read(at);
  });
  return group;
}

function legend(detail, baseline, axis, time) {
  const moments = detail.series.filter((series) => series.moment !== null).sort((a, b) => a.moment - b.moment);
  const first = moments.length ? `Out of its bounds first at ${figure(moments[0].moment)} s: ${moments[0].criterion}` : null;
  const after = axis.length > 0 && axis.end > axis.length ? `the window ends at ${figure(axis.length)} s, what is behind is shaded` : null;
  return el("p", { class: "legend note" }, first ? el("strong", { class: "first" }, first) : null,
    el("span", {}, el("i", { class: "key own" }), "this case"),
    baseline && baseline.series.length ? el("span", {}, el("i", { class: "key other" }), `${baseline.called}: ${baseline.name}`) : null,
    el("span", {}, el("i", { class: "key bound" }), "bound"),
    after ? el("span", {}, after) : null, time);
}

function chart(series, axis, baseline) {
  const found = baseline ? baseline.series.find((each) => each.criterion === series.criterion) : null;
  const other = found && found.points.length ? found : null;
  const value = el("output", { class: "value" });
  const bounds = [series.low !== null ? `at least ${figure(series.low, series.unit)}` : null,
    series.high !== null ? `at most ${figure(series.high, series.unit)}` : null].filter(Boolean).join(", ");
  const head = el("figcaption", {}, el("span", { class: `word ${series.outcome}` }, series.criterion),
    el("span", {}, ` ${series.label} `), el("small", {}, bounds), value);
  if (series.points.length === 0 && series.odd.length === 0) {
    return { node: el("figure", { class: "chart" }, head, el("p", { class: "note" }, "no value")), read: () => {} };
  }
  const scale = valueAxis(series, other);
  const line = svg("line", { class: "cursor", y1: 0, y2: HIGH, x1: -9, x2: -9 });
  const picture = svg("svg", { class: "plot", viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: "none", role: "img",
    "aria-label": `${series.criterion}: ${figure(scale.low)} to ${figure(scale.high, series.unit)}` },
  shades(series, axis, scale), limits(series, scale),
  other ? svg("path", { class: "other", d: pathOf(other, axis, scale) }) : null,
  svg("path", { class: "own", d: pathOf(series, axis, scale) }),
  svg("path", { class: "out", d: outside(series).map(([at, v]) => `M${axis.x(at).toFixed(1)} ${scale.y(v).toFixed(1)}h0`).join("") }),
  series.odd.map((at) => svg("line", { class: "odd", x1: axis.x(at), x2: axis.x(at), y1: 0, y2: HIGH })),
  series.moment === null ? null : svg("line", { class: "moment", x1: axis.x(series.moment), x2: axis.x(series.moment), y1: 0, y2: HIGH }), line);
  const node = el("figure", { class: "chart" }, head, el("div", { class: "frame" }, picture,
    el("span", { class: "most" }, figure(scale.high, series.unit)), el("span", { class: "least" }, figure(scale.low, series.unit))));
  return { node, read: (at) => {
    line.setAttribute("x1", at === null ? -9 : axis.x(at));
    line.setAttribute("x2", at === null ? -9 : axis.x(at));
    value.textContent = at === null ? "" : readOut(series, other, at);
  } };
}

function readOut(series, other, at) {
  const own = pointAt(series, at), theirs = other ? pointAt(other, at) : null;
  return [own ? figure(own[1], series.unit) : null, theirs ? `baseline ${figure(theirs[1], series.unit)}` : null].filter(Boolean).join(" · ");
}

function pathOf(series, axis, scale) {
  let before = null;
  return series.points.map(([at, value]) => {
    const x = axis.x(at).toFixed(1), y = scale.y(value).toFixed(1);
    const part = before === null ? `M${x} ${y}` : series.step ? `H${x}V${y}` : `L${x} ${y}`;
    before = y;
    return part;
  }).join("");
}

// A sum that is still too small, and a pose that is still far from its goal, are not out of bounds.
const outside = (series) => series.moment === null ? [] : series.points.filter(([at, value]) => at >= series.moment
  && ((series.low !== null && value < series.low) || (series.high !== null && value > series.high)));

const limits = (series, scale) => [series.low, series.high].filter((value) => value !== null)
  .map((value) => svg("line", { class: "limit", x1: 0, x2: WIDE, y1: scale.y(value), y2: scale.y(value) }));

function shades(series, axis, scale) {
  const parts = [];
  if (series.high !== null) parts.push(svg("rect", { class: "beyond", x: 0, width: WIDE, y: 0, height: Math.max(0, scale.y(series.high)) }));
  if (series.low !== null) parts.push(svg("rect", { class: "beyond", x: 0, width: WIDE, y: scale.y(series.low), height: Math.max(0, HIGH - scale.y(series.low)) }));
  for (const [from, to] of [[axis.begin, 0], [axis.length, axis.end]]) {
    if (axis.length > 0 && to > from) parts.push(svg("rect", { class: "behind", x: axis.x(from), width: axis.x(to) - axis.x(from), y: 0, height: HIGH }));
  }
  return parts;
}

function logLane(lines, axis) {
  const text = el("output", { class: "value" });
  const line = svg("line", { class: "cursor", y1: 0, y2: HIGH, x1: -9, x2: -9 });
  const ticks = lines.map((each) => svg("line", { class: `tick ${each.level}`, x1: axis.x(each.at), x2: axis.x(each.at), y1: 10, y2: 90 }));
  const node = el("figure", { class: "chart lane" }, el("figcaption", {}, "What was written, by its time", text),
    el("div", { class: "frame" }, svg("svg", { class: "plot", viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: "none", role: "img", "aria-label": `${lines.length} lines` }, ticks, line)),
  el("ul", { class: "lines mono" }, lines.map((each) => el("li", { class: each.level }, el("b", {}, `${each.at.toFixed(3)} s ${each.level}`), each.text))));
  return { node, read: (at) => {
    line.setAttribute("x1", at === null ? -9 : axis.x(at));
    line.setAttribute("x2", at === null ? -9 : axis.x(at));
    const near = at === null ? null : lines.reduce((best, each) => Math.abs(each.at - at) < Math.abs(best.at - at) ? each : best);
    text.textContent = near && Math.abs(near.at - at) <= (axis.end - axis.begin) / 50 ? near.text : "";
  } };
}

function cursor(group, axis, read) {
  let at = null;
  const set = (wanted) => { at = wanted; read(at); };
  group.addEventListener("pointermove", (event) => {
    const plot = group.querySelector(".plot");
    if (!plot) return;
    const place = plot.getBoundingClientRect();
    const share = Math.max(0, Math.min(1, (event.clientX - place.left) / place.width));
    set(axis.begin + share * (axis.end - axis.begin));
  });
  group.addEventListener("pointerleave", () => set(null));
  group.addEventListener("blur", () => set(null));
  group.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10 }[event.key];
    if (!step) return;
    event.preventDefault();
    const moved = (at === null ? axis.begin : at) + step * (axis.end - axis.begin) / 100;
    set(Math.max(axis.begin, Math.min(axis.end, moved)));
  });
}
