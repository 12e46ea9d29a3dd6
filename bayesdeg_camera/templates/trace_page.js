"use strict";
const SVG = "http://www.w3.org/2000/svg";
const by = (id) => document.getElementById(id);
const state = { photographs: [], number: 0, points: [], moved: new Set(), groups: [], segments: [] };

const make = (name, attributes, parent) => {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  parent.append(element);
  return element;
};

const say = (text, wrong = false) => {
  by("said").textContent = text;
  by("said").classList.toggle("wrong", wrong);
};

const current = () => state.photographs[state.number];

const describe = () => {
  const one = current();
  const doubts = one.not_sure.length ? ` · not sure: ${one.not_sure.join("; ")}` : "";
  const changed = one.corrected ? " · corrected by hand" : "";
  by("read").textContent = `bend angle ${one.bend_angle_deg.toFixed(2)}°, curvature ` +
    `${one.curvature_per_m.toFixed(2)} 1/m, length ${one.length_mm.toFixed(2)} mm${changed}${doubts}`;
};

const enable = () => {
  by("save").disabled = by("undo").disabled = state.moved.size === 0;
};

// the size of handles on the screen does not depend on the zoom
const radius = () => current().width / by("drawing").getBoundingClientRect().width;

const place = () => {
  const r = radius();
  state.points.forEach(([x, y], i) => {
    const [handle, dot] = state.groups[i].children;
    for (const [circle, size] of [[handle, 9], [dot, 2.6]]) {
      circle.setAttribute("cx", x);
      circle.setAttribute("cy", y);
      circle.setAttribute("r", size * r);
    }
    dot.classList.toggle("moved", state.moved.has(i));
    state.groups[i].setAttribute("aria-label",
      `point ${i + 1} of ${state.points.length}, ${x.toFixed(1)} right, ${y.toFixed(1)} down`);
    if (i > 0) {
      const [a, b] = state.points[i - 1];
      const line = state.segments[i - 1];
      for (const [key, value] of Object.entries({ x1: a, y1: b, x2: x, y2: y })) line.setAttribute(key, value);
    }
  });
  const ring = by("clamp");
  ring.setAttribute("cx", state.points[0][0]);
  ring.setAttribute("cy", state.points[0][1]);
  ring.setAttribute("r", 12 * r);
};

const draw = () => {
  const one = current(), drawing = by("drawing");
  state.points = one.pixels.map(([x, y]) => [x, y]);
  state.moved = new Set();
  drawing.replaceChildren();
  drawing.setAttribute("viewBox", `0 0 ${one.width} ${one.height}`);
  const image = make("image", { width: one.width, height: one.height, href: `photograph/${state.number}` }, drawing);
  image.addEventListener("error", () => say("the photograph cannot be shown", true));
  image.addEventListener("load", () => { drawing.dataset.loaded = state.number; });
  const kind = (i) => (one.seen[i] ? "seen" : "between");
  state.segments = state.points.slice(1).map((_, i) => make("line",
    { class: `segment ${one.seen[i] && one.seen[i + 1] ? "seen" : "between"}` }, drawing));
  make("circle", { class: "clamp", id: "clamp" }, drawing);
  state.groups = state.points.map((_, i) => {
    const group = make("g", { tabindex: "0", role: "button", "data-point": i }, drawing);
    make("circle", { class: "handle" }, group);
    make("circle", { class: `dot ${kind(i)}` }, group);
    return group;
  });
  by("choice").value = state.number;
  describe();
  enable();
  place();
};

const move = (index, dx, dy, from = state.points) => {
  const reach = Number(by("reach").value), { width, height } = current();
  from.forEach(([x, y], i) => {
    const off = Math.abs(i - index);
    if (off > reach) return;
    const share = 0.5 * (1 + Math.cos(Math.PI * off / (reach + 1)));
    state.points[i] = [
      Math.min(width, Math.max(0, x + share * dx)),
      Math.min(height, Math.max(0, y + share * dy)),
    ];
    state.moved.add(i);
  });
  say("not saved yet");
  enable();
  place();
};

const at = (event) => {
  const matrix = by("drawing").getScreenCTM().inverse();
  const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix);
  return [point.x, point.y];
};

by("drawing").addEventListener("pointerdown", (event) => {
  const group = event.target.closest("[data-point]");
  if (!group) return;
  event.preventDefault();
  group.focus({ preventScroll: true });
  const index = Number(group.dataset.point), start = at(event), from = state.points.map((p) => [...p]);
  by("drawing").setPointerCapture(event.pointerId);
  const dragged = (e) => {
    const [x, y] = at(e);
    move(index, x - start[0], y - start[1], from);
  };
  const dropped = () => {
    by("drawing").removeEventListener("pointermove", dragged);
    by("drawing").removeEventListener("pointerup", dropped);
    by("drawing").removeEventListener("pointercancel", dropped);
  };
  by("drawing").addEventListener("pointermove", dragged);
  by("drawing").addEventListener("pointerup", dropped);
  by("drawing").addEventListener("pointercancel", dropped);
});

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
by("drawing").addEventListener("keydown", (event) => {
  const group = event.target.closest("[data-point]"), arrow = ARROWS[event.key];
  if (!group || !arrow) return;
  event.preventDefault();
  const far = event.shiftKey ? 10 : 1;
  move(Number(group.dataset.point), far * arrow[0], far * arrow[1], state.points.map((p) => [...p]));
});

const show = (number) => {
  if (state.moved.size && !confirm("Moved points are not saved. Discard them?")) {
    by("choice").value = state.number;
    return;
  }
  state.number = (number + state.photographs.length) % state.photographs.length;
  say("");
  draw();
};

const save = async () => {
  const number = state.number;
  by("save").disabled = true;
  try {
    const answer = await fetch("save", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ number, pixels: state.points }),
    });
    const found = await answer.json();
    if (!answer.ok) throw new Error(found.error);
    state.photographs[number] = found;
    label(number);
    if (number === state.number) draw();
    say(`${found.file} is saved`);
  } catch (fault) {
    say(`not saved: ${fault.message}`, true);
    enable();
  }
};

const label = (number) => {
  const one = state.photographs[number];
  by("choice").options[number].textContent = `${one.file}${one.corrected ? " (corrected)" : ""}`;
};

by("save").addEventListener("click", save);
by("undo").addEventListener("click", () => { say(""); draw(); });
by("choice").addEventListener("change", (event) => show(Number(event.target.value)));
by("previous").addEventListener("click", () => show(state.number - 1));
by("next").addEventListener("click", () => show(state.number + 1));
by("reach").addEventListener("input", (event) => { by("reach-shown").textContent = event.target.value; });
by("zoom").addEventListener("change", (event) => {
  by("drawing").setAttribute("class", `x${event.target.value}`);
  place();
});
addEventListener("resize", () => { if (state.groups.length) place(); });
addEventListener("beforeunload", (event) => { if (state.moved.size) event.preventDefault(); });

fetch("photographs.json").then((answer) => answer.json()).then((found) => {
  state.photographs = found;
  found.forEach((_, i) => {
    const option = document.createElement("option");
    option.value = i;
    by("choice").append(option);
    label(i);
  });
  draw();
}).catch(() => say("the command behind this page has ended; start it again", true));
