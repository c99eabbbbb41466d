"use strict";
const $ = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
let state = null;
let angle = 0;
let busy = false;

function svg(name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

const at = (pose) => `translate(${pose.x_mm} ${pose.y_mm}) rotate(${pose.theta_deg})`;

function sensor(pose, kind) {
  const [width, height] = state.view_mm;
  return svg("rect", { x: -width / 2, y: -height / 2, width, height, rx: 0.6, class: kind, transform: at(pose) });
}

function drawPlate() {
  const half = state.plate_half_mm + Math.hypot(...state.view_mm) / 2;
  const plate = $("plate");
  plate.setAttribute("viewBox", `${-half} ${-half} ${2 * half} ${2 * half}`);
  const drawn = [];
  if (!state.touches.length) {
    const [mm] = state.first_reach;
    drawn.push(svg("rect", { x: -mm, y: -mm, width: 2 * mm, height: 2 * mm, class: "reach" }));
  }
  if (state.named) drawn.push(svg("path", { d: state.parts[state.named.part].outline, class: "named", transform: at(state.named.at) }));
  state.touches.forEach((pose, n) => {
    drawn.push(sensor(pose, n + 1 === state.touches.length ? "sensor last" : "sensor"));
    drawn.push(svg("text", { x: pose.x_mm, y: pose.y_mm, "font-size": half / 14 }, String(n + 1)));
  });
  if (state.next) drawn.push(sensor(state.next, "next"));
  if (state.truth) drawn.push(svg("path", { d: state.parts[state.truth[0]].outline, class: "truth", transform: at(state.truth[1]) }));
  const here = sensor({ x_mm: 0, y_mm: 0, theta_deg: angle }, "here");
  here.id = "here";
  here.setAttribute("visibility", "hidden");
  drawn.push(here);
  plate.replaceChildren(...drawn);
}

function drawParts() {
  const order = state.parts.map((_, part) => part).sort((a, b) => state.parts[b].probability - state.parts[a].probability);
  const half = Math.max(...state.parts.map((part) => part.belief_half_mm));
  const shown = state.named ? order : state.parts.map((_, part) => part);
  $("parts").replaceChildren(...shown.map((index) => {
    const part = state.parts[index];
    const item = document.createElement("li");
    if (state.named && index === state.named.part) item.className = "likeliest";
    const picture = svg("svg", { viewBox: `${-half} ${-half} ${2 * half} ${2 * half}`, "aria-hidden": "true" });
    if (part.belief) {
      const of = part.belief_half_mm;
      picture.append(svg("image", { href: part.belief, x: -of, y: -of, width: 2 * of, height: 2 * of }));
    }
    picture.append(svg("path", { d: part.outline }));
    const name = document.createElement("div");
    name.textContent = `${part.name} ${(100 * part.probability).toFixed(part.probability < 0.095 ? 1 : 0)} %`;
    const bar = document.createElement("div");
    bar.className = "bar";
    const filled = document.createElement("i");
    filled.style.width = `${100 * part.probability}%`;
    bar.append(filled);
    item.append(picture, name, bar);
    return item;
  }));
}

function answer() {
  const named = state.named;
  if (!named) return "Nothing was touched yet. Begin within the dashed square.";
  const percent = (p) => `${(100 * p).toFixed(1)}\u00a0%`;
  const n = state.touches.length;
  const part = state.parts[named.part].name;
  const [x, y, deg] = named.deviations;
  const stops = {
    confident: `Sure: this is the hole of ${part}.`,
    "none-of-these": "The hole is of none of these parts.",
    "touch-limit": `No more touches: most likely the hole of ${part}.`,
    "nothing-to-learn": `Nothing left to learn: most likely the hole of ${part}.`,
  };
  const said = stops[named.stop] || `Most likely the hole of ${part}.`;
  const none = named.none === null ? "" : ` None of these: ${percent(named.none)}.`;
  const place = `Place known to ${Math.max(x, y).toFixed(2)} mm and ${deg.toFixed(1)}°.`;
  const truth = state.truth ? ` It is the hole of ${state.parts[state.truth[0]].name}.` : "";
  return `${n} ${n === 1 ? "touch" : "touches"}. ${said} ${percent(named.probability)} among the parts.${none} ${place}${truth}`;
}

function draw() {
  drawPlate();
  drawParts();
  $("picture").src = state.picture;
  for (const name of ["changed", "felt"]) {
    $(name).hidden = $(`${name}-words`).hidden = !state[name];
    if (state[name]) $(name).src = state[name];
  }
  $("answer").textContent = answer();
  $("advised").disabled = !state.next;
  $("show").disabled = Boolean(state.truth);
}

async function ask(path, body) {
  if (busy) return;
  busy = true;
  try {
    const options = body === undefined ? {} : { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
    const reply = await fetch(path, options);
    const text = await reply.text();
    $("error").textContent = reply.ok ? "" : text;
    if (reply.ok) {
      state = JSON.parse(text);
      draw();
    }
  } catch (error) {
    $("error").textContent = "The program does not answer. Is it still running?";
  } finally {
    busy = false;
  }
}

function place(event) {
  const plate = $("plate");
  const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(plate.getScreenCTM().inverse());
  return { x_mm: point.x, y_mm: point.y, theta_deg: angle };
}

function turn(degrees) {
  angle = ((degrees + 540) % 360) - 180;
  $("angle").value = angle;
  $("degrees").textContent = `${angle}°`;
}

$("plate").addEventListener("click", (event) => ask("touch", place(event)));
$("plate").addEventListener("pointermove", (event) => {
  const here = $("here");
  if (!here || event.pointerType === "touch") return;
  here.setAttribute("transform", at(place(event)));
  here.setAttribute("visibility", "visible");
});
$("plate").addEventListener("pointerleave", () => $("here") && $("here").setAttribute("visibility", "hidden"));
$("plate").addEventListener("wheel", (event) => {
  event.preventDefault();
  turn(angle + (event.deltaY > 0 ? 5 : -5));
  const here = $("here");
  if (here) here.setAttribute("transform", at(place(event)));
}, { passive: false });
$("angle").addEventListener("input", () => turn(Number($("angle").value)));
$("advised").addEventListener("click", () => state.next && ask("touch", state.next));
$("show").addEventListener("click", () => ask("show", {}));
$("renew").addEventListener("click", () => ask("renew", {}));
ask("state");
