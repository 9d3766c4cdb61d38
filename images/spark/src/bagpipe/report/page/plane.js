// Where things were on the ground: the path that was judged, the truth's or an obstacle's, the baseline's, and the goal.

function plane(series, baseline) {
  if (!series.plane) return null;
  const found = baseline ? baseline.series.find((each) => each.criterion === series.criterion) : null;
  const theirs = found && found.plane ? found.plane.paths.slice(0, 1) : [];
  const own = series.plane.paths, goal = series.plane.goal;
  const points = [...own, ...theirs].flatMap((path) => path.points.map(([, x, y]) => [x, y]));
  if (points.length === 0) return null;
  if (goal) points.push([goal[0] - goal[2], goal[1] - goal[2]], [goal[0] + goal[2], goal[1] + goal[2]]);
  const low = [0, 1].map((axis) => Math.min(...points.map((point) => point[axis])));
  const high = [0, 1].map((axis) => Math.max(...points.map((point) => point[axis])));
  // One scale for both axes, so that a circle is one; some room where a path is one place.
  const span = Math.max(high[0] - low[0], (high[1] - low[1]) * 2.5) || 1;
  const scale = 900 / span, height = Math.max(80, (high[1] - low[1]) * scale) + 40;
  const x = (value) => 500 + (value - (low[0] + high[0]) / 2) * scale;
  const y = (value) => height / 2 - (value - (low[1] + high[1]) / 2) * scale;
  const line = (path, kind) => svg("path", { class: kind, d: path.points.map(([, a, b], at) => `${at ? "L" : "M"}${x(a).toFixed(1)} ${y(b).toFixed(1)}`).join("") });
  const marks = own.map((path) => ({ path, mark: svg("path", { class: "here" }) }));
  const last = own[0].points[own[0].points.length - 1];
  const picture = svg("svg", { class: "plane", viewBox: `0 0 1000 ${height.toFixed(0)}`, role: "img", "aria-label": `${series.criterion} in the plane: ${own.map((path) => path.name).join(", ")}` },
    goal ? svg("circle", { class: "goal", cx: x(goal[0]), cy: y(goal[1]), r: Math.max(3, goal[2] * scale) }) : null,
    theirs.map((path) => line(path, "other")), own.slice(1).map((path) => line(path, "second")), line(own[0], "own"),
    last ? svg("path", { class: "end", d: `M${x(last[1]).toFixed(1)} ${y(last[2]).toFixed(1)}h0` }) : null, marks.map((each) => each.mark));
  const names = [own[0].name, ...own.slice(1).map((path) => `${path.name} (dotted)`), theirs.length ? "the baseline (dashed)" : null, goal ? "goal (circle)" : null];
  const node = el("figure", { class: "chart" }, el("figcaption", {}, el("span", {}, `${series.criterion} in the plane: ${names.filter(Boolean).join(", ")}`),
    el("small", {}, `${figure(low[0])} to ${figure(high[0])} across, ${figure(low[1])} to ${figure(high[1])} up`)), el("div", { class: "frame" }, picture));
  return { node, read: (at) => {
    for (const { path, mark } of marks) {
      const point = at === null || path.points.length === 0 ? null : pointAt(path, at);
      if (point) mark.setAttribute("d", `M${x(point[1]).toFixed(1)} ${y(point[2]).toFixed(1)}h0`); else mark.removeAttribute("d");
    }
  } };
}
