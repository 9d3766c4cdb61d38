// Elements. Text is always set as text: what a stack or a recording wrote never becomes HTML.

const SVG = "http://www.w3.org/2000/svg";

function made(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children.flat(Infinity)) {
    if (child !== null && child !== undefined && child !== false) {
      node.append(child instanceof Node ? child : String(child));
    }
  }
  return node;
}

const el = (name, attributes, ...children) => made(document.createElement(name), attributes, children);
const svg = (name, attributes, ...children) => made(document.createElementNS(SVG, name), attributes, children);
const byId = (id) => document.getElementById(id);

function figure(value, unit) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  // Four digits, and two behind the point of a large one: coordinates of a map differ there.
  const digits = Math.max(4, Math.floor(Math.log10(size || 1)) + 3);
  const text = Number.isInteger(value) && size < 1e9
    ? value.toLocaleString("en-US")
    : size !== 0 && (size < 1e-3 || size >= 1e9) ? value.toExponential(3) : String(Number(value.toPrecision(digits)));
  return unit ? `${text} ${unit}` : text;
}

const asText = (value) => typeof value === "string" ? value : JSON.stringify(value);
