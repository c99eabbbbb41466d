"use strict";
const $ = (id) => document.getElementById(id);
const PERIOD_MS = 100;

function rows(list, items, fill) {
  while (list.children.length > items.length) list.lastChild.remove();
  while (list.children.length < items.length) list.append(document.createElement("li"));
  items.forEach((item, n) => fill(list.children[n], item));
}

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// The belief over the places of the likeliest part, darker where it is more probable, with its outline, the touches and the next one.
function drawMap(view, touched, outline) {
  const canvas = $("map");
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  const part = view.place && view.parts.find((one) => one.name === view.place.part);
  $("where").textContent = view.place ? `Where the sensor is on ${view.place.part}` : "Where the sensor is on the likeliest part";
  if (!part || !part.map) return;
  const { n_xy: n, half_mm: half, values } = part.map;
  const believed = 2 * half * (n > 1 ? n / (n - 1) : 1);
  const span = (outline || []).reduce((most, [x, y]) => Math.max(most, 2.1 * Math.abs(x), 2.1 * Math.abs(y)), believed);
  const scale = canvas.width / span;
  const at = (mm) => canvas.width / 2 + mm * scale;
  const most = Math.max(...values, Number.MIN_VALUE);
  const cell = (believed * scale) / n;
  const corner = at(-believed / 2);
  context.fillStyle = colour("--touch");
  values.forEach((value, index) => {
    context.globalAlpha = Math.sqrt(Math.max(value, 0) / most);
    context.fillRect(corner + Math.floor(index / n) * cell, corner + (index % n) * cell, cell + 0.5, cell + 0.5);
  });
  context.globalAlpha = 1;
  context.fillStyle = colour("--ink");
  const dot = Math.max(0.3 * scale, 1.5);
  (outline || []).forEach(([x, y]) => context.fillRect(at(x) - dot / 2, at(y) - dot / 2, dot, dot));
  context.font = "15px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = colour("--ink");
  touched.forEach((pose, n) => context.fillText(String(n + 1), at(pose.x_mm), at(pose.y_mm)));
  const next = view.sensor_from_next;
  if (next && touched.length) {
    const last = touched[touched.length - 1];
    const [sin, cos] = [Math.sin(last.theta_rad), Math.cos(last.theta_rad)];
    const [x, y] = [last.x_mm + cos * next.x_mm - sin * next.y_mm, last.y_mm + sin * next.x_mm + cos * next.y_mm];
    context.strokeStyle = colour("--next");
    context.setLineDash([5, 4]);
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(at(last.x_mm), at(last.y_mm));
    context.lineTo(at(x), at(y));
    context.stroke();
    context.beginPath();
    context.arc(at(x), at(y), 9, 0, 2 * Math.PI);
    context.stroke();
  }
}

// Of a log any moment can be shown; at the slider's end what comes last.
let atEnd = true;

function drawTime(end, now) {
  $("time").hidden = end === null;
  if (end === null) return;
  $("at").max = end;
  if (atEnd) $("at").value = end;
  $("at-words").textContent = `${now.toFixed(1)} of ${end.toFixed(1)}`;
}

$("at").addEventListener("input", () => {
  atEnd = Number($("at").value) >= Number($("at").max);
});

function draw({ view, touched, picture, outline, felt, end_s: end }) {
  drawTime(end, view.time_s);
  $("status").textContent = view.status || "Waiting for the first touch.";
  drawMap(view, touched, outline);
  const place = view.place;
  const n = view.touches.filter((touch) => touch.refused === null).length;
  let said = "No touch yet.";
  if (place) {
    said = `${n} ${n === 1 ? "touch" : "touches"}. ${place.part}: ${(100 * place.probability).toFixed(1)}\u00a0%.`;
    if (place.other) said += ` It may be ${place.other}, too.`;
    said += ` Place known to ${Math.max(...place.sd_mm).toFixed(2)} mm and ${place.sd_deg.toFixed(1)}°.`;
    said += view.stop ? ` Stopped: ${view.stop}.` : view.sensor_from_next ? " The next touch is planned." : "";
  }
  $("answer").textContent = said;
  $("picture").hidden = !picture;
  if (picture) $("picture").src = picture;
  $("felt").hidden = $("felt-words").hidden = !felt;
  if (felt) $("felt").src = felt;
  const camera = view.camera;
  const rate = camera.frames_per_s === null ? "no pictures" : `${camera.frames_per_s.toFixed(1)} pictures a second`;
  $("camera").textContent = `What the camera sees: ${rate}${camera.is_good ? "" : ", not trusted now"}`;
  rows($("messages"), view.messages.slice(-6).reverse(), (item, message) => {
    item.className = message.level;
    item.textContent = `${message.time_s.toFixed(1)} s  ${message.text}`;
  });
  rows($("parts"), view.parts.slice(0, 24), (item, part) => {
    if (!item.firstChild) {
      const bar = document.createElement("div");
      bar.className = "bar";
      bar.append(document.createElement("i"));
      item.append(document.createElement("span"), bar);
    }
    item.firstChild.textContent = `${part.name} ${(100 * part.probability).toFixed(1)}\u00a0%`;
    item.querySelector("i").style.width = `${100 * part.probability}%`;
  });
}

async function follow() {
  try {
    const reply = await fetch(atEnd ? "view" : `view?at=${$("at").value}`);
    if (!reply.ok) throw new Error(await reply.text());
    draw(await reply.json());
  } catch (error) {
    $("status").textContent = "The node does not answer; asking again.";
  }
  setTimeout(follow, PERIOD_MS);
}

follow();
