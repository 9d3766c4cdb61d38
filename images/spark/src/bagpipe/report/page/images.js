// What cameras showed at a case's failing moment. Of a picture only these types are ever named to the browser.

const PICTURES = ["image/png", "image/jpeg"];

function cameras(detail) {
  const shown = detail.images || [];
  if (shown.length === 0 && !detail.unseen) return null;
  const left = detail.unseen ? el("p", { class: "note" }, `${detail.unseen} more are left out here for size: its line of results.jsonl has them.`) : null;
  return [el("h4", {}, "What the cameras showed at the failing moment"), shown.length ? el("div", { class: "cameras" }, shown.map(camera)) : null, left];
}

function camera(image) {
  const head = [el("b", { class: "mono" }, image.topic), ` ${image.of === "input" ? "of the input" : "of the stack"}`];
  if (!PICTURES.includes(image.type)) return el("figure", { class: "camera" }, el("figcaption", {}, head, el("p", { class: "note" }, `No picture: ${image.fault}.`)));
  const size = image.width && image.height ? `, ${image.width} × ${image.height}` : "";
  return el("figure", { class: "camera" },
    el("img", { src: `data:${image.type};base64,${image.data}`, alt: `${image.topic} at ${figure(image.at)} s` }),
    el("figcaption", {}, head, ` at ${image.at.toFixed(3)} s${size}`));
}
