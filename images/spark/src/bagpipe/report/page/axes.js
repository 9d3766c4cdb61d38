// What the charts of a case share: one axis of time, the baseline's course, and the values at a time.

const WIDE = 1000, HIGH = 100;

// From the window's start, or what came before it, to its end, or what came after it.
function timeAxis(series, window, lines) {
  const length = window ? (window[2] - window[1]) / 1e9 : 0;
  let begin = 0, end = length;
  for (const each of series) {
    // A course may have no value but times at which there was none.
    const times = [each.points[0], each.points[each.points.length - 1]].filter(Boolean).map(([at]) => at);
    for (const at of [...times, ...each.odd]) {
      begin = Math.min(begin, at);
      end = Math.max(end, at);
    }
  }
  for (const line of lines) { begin = Math.min(begin, line.at); end = Math.max(end, line.at); }
  if (end <= begin) end = begin + 1;
  return { begin, end, length, x: (at) => (at - begin) / (end - begin) * WIDE };
}

function valueAxis(series, other) {
  const values = [...series.points, ...(other ? other.points : [])].map((point) => point[1])
    .concat([series.low, series.high].filter((value) => value !== null));
  let low = Infinity, high = -Infinity;
  for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
  // Room for the words of the least and the greatest value.
  const rest = low === high ? 0.5 : (high - low) * 0.18;
  const bottom = low - rest, top = high + rest;
  return { low, high, y: (value) => (top - value) / (top - bottom) * HIGH };
}

// The place of the last point at or before a time; the first one before there is any.
function placeAt(points, at) {
  let first = 0, last = points.length - 1;
  while (first < last) {
    const middle = Math.ceil((first + last) / 2);
    if (points[middle][0] <= at) first = middle; else last = middle - 1;
  }
  return first;
}

// The point that is nearest in time; of a course of steps the one that holds.
function pointAt(series, at) {
  if (series.points.length === 0) return null;
  const place = placeAt(series.points, at), after = series.points[place + 1];
  const point = series.points[place];
  return !series.step && after && after[0] - at < at - point[0] ? after : point;
}

function baselineOf(name) {
  const found = Object.hasOwn(DATA.baselines, name) ? DATA.baselines[name] : null;
  if (!found) return null;
  const own = Object.hasOwn(DATA.details, found.case) ? DATA.details[found.case].series : [];
  return { name: found.case, called: found.called, series: found.series || own };
}
