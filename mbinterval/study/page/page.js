"use strict";

const byId = (id) => document.getElementById(id);
const pictures = JSON.parse(byId("data").textContent);

// Pictures: two of them under a slider, the error maps of both beside it, one zoom for all.

const view = { scale: 1, x: 0, y: 0 };  // x, y: upper left corner, as parts of the picture
const views = [...document.querySelectorAll(".view")];

function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

function draw() {
  const most = 1 - 1 / view.scale;
  view.x = clamp(view.x, 0, most);
  view.y = clamp(view.y, 0, most);
  for (const element of views) {
    for (const image of element.querySelectorAll("img")) {
      image.style.transform =
        `scale(${view.scale}) translate(${-100 * view.x}%, ${-100 * view.y}%)`;
      image.classList.toggle("sharp", view.scale > 2);
    }
  }
  const split = Number(byId("split").value) / 100;
  byId("divider").style.left = `${100 * split}%`;
  const from = 100 * (view.x + split / view.scale);  // in the right picture's own coordinates
  byId("right-image").style.clipPath = `inset(0 0 0 ${from}%)`;
  byId("zoom").textContent = `${Math.round(10 * view.scale) / 10}x`;
}

function zoom(factor, atX = 0.5, atY = 0.5) {
  const before = view.scale;
  view.scale = clamp(before * factor, 1, 64);
  view.x += atX / before - atX / view.scale;
  view.y += atY / before - atY / view.scale;
  draw();
}

function choose() {
  const [left, right] = ["left", "right"].map((side) => pictures[byId(side).selectedIndex]);
  const show = (id, uri, alt) => {
    if (uri) byId(id).src = uri; else byId(id).removeAttribute("src");
    byId(id).alt = alt;
  };
  show("left-image", left.image, left.name);
  show("right-image", right.image, right.name);
  show("left-map", left.map, `error of ${left.name}`);
  show("right-map", right.map, `error of ${right.name}`);
  const told = (one) => (one.told ? `${one.name} (${one.told})` : one.name);
  byId("told").textContent = `left: ${told(left)}; right: ${told(right)}`;
}

function setUpPictures() {
  const left = Math.max(pictures.findIndex((one) => one.told), 0);
  const other = (one) => one.told && one.method !== pictures[left].method;
  const right = Math.max(pictures.findIndex(other), 0);
  for (const [side, first] of [["left", left], ["right", right]]) {
    const select = byId(side);
    for (const picture of pictures) select.add(new Option(picture.name));
    select.selectedIndex = first;
    select.addEventListener("change", choose);
  }
  byId("left-image").addEventListener("load", (event) => {
    const shape = `${event.target.naturalWidth} / ${event.target.naturalHeight}`;
    for (const element of views) element.style.aspectRatio = shape;
  });
  byId("split").addEventListener("input", draw);
  byId("in").addEventListener("click", () => zoom(2));
  byId("out").addEventListener("click", () => zoom(0.5));
  byId("reset").addEventListener("click", () => zoom(0));
  for (const element of views) listen(element);
  choose();
  draw();
}

function listen(element) {
  const part = (event) => {
    const box = element.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  element.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;  // the page scrolls
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.25 : 0.8, ...part(event));
  }, { passive: false });
  element.addEventListener("pointerdown", (event) => element.setPointerCapture(event.pointerId));
  element.addEventListener("pointermove", (event) => {
    if (!element.hasPointerCapture(event.pointerId)) return;
    const box = element.getBoundingClientRect();
    view.x -= event.movementX / box.width / view.scale;
    view.y -= event.movementY / box.height / view.scale;
    draw();
  });
  element.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const action = keys[event.key];
    if (action) {
      event.preventDefault();
      action();
    }
  });
}

function move(x, y) {
  view.x += x / view.scale / 10;
  view.y += y / view.scale / 10;
  draw();
}

function slide(by) {
  byId("split").value = Number(byId("split").value) + by;
  draw();
}

function step(by) {
  const select = byId("right");
  select.selectedIndex = (select.selectedIndex + by + pictures.length) % pictures.length;
  choose();
}

const keys = {
  "+": () => zoom(2), "=": () => zoom(2), "-": () => zoom(0.5), "0": () => zoom(0),
  ArrowLeft: () => move(-1, 0), ArrowRight: () => move(1, 0),
  ArrowUp: () => move(0, -1), ArrowDown: () => move(0, 1),
  "[": () => slide(-5), "]": () => slide(5), "<": () => step(-1), ">": () => step(1),
};

// Plots: a name in a legend hides and shows its lines.

function toggle(entry) {
  const pressed = entry.getAttribute("aria-pressed") !== "true";
  entry.setAttribute("aria-pressed", pressed);
  for (const series of entry.closest("svg").querySelectorAll(".series")) {
    if (series.dataset.series === entry.dataset.series) series.classList.toggle("hidden", !pressed);
  }
}

function setUpPlots() {
  for (const entry of document.querySelectorAll(".legend")) {
    entry.addEventListener("click", () => toggle(entry));
    entry.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      toggle(entry);
    });
  }
}

// Tables: columns sort, figures by value and before words; a table is copied with tabs.

function value(row, column) {
  const text = row.cells[column].textContent.replace("*", "").replaceAll(",", "");
  const figure = parseFloat(text);
  return /^[+-]?[\d.]+(e[+-]?\d+)?%?$/i.test(text) ? figure : text;
}

function compare(a, b) {
  if (typeof a === typeof b) return typeof a === "number" ? a - b : a.localeCompare(b);
  return typeof a === "number" ? -1 : 1;
}

function sort(head) {
  const table = head.closest("table"), column = head.cellIndex;
  const down = head.getAttribute("aria-sort") === "ascending";
  for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  const rows = [...table.tBodies[0].rows];
  rows.sort((a, b) => (down ? -1 : 1) * compare(value(a, column), value(b, column)));
  table.tBodies[0].append(...rows);
}

async function copy(table) {
  const lines = [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent));
  const text = lines.map((cells) => cells.join("\t")).join("\n");
  try {
    await navigator.clipboard.writeText(text);
    say("Copied");
  } catch {  // pages that were opened as a file may not write to the clipboard everywhere
    getSelection().selectAllChildren(table);
    say(document.execCommand("copy") ? "Copied" : "Selected: press Ctrl+C");
  }
}

function say(text) {
  byId("said").textContent = text;
  setTimeout(() => { byId("said").textContent = ""; }, 2000);
}

for (const button of document.querySelectorAll(".sort")) {
  button.addEventListener("click", () => sort(button.closest("th")));
}
for (const button of document.querySelectorAll(".copy")) {
  button.addEventListener("click", () => copy(button.parentNode.querySelector("table")));
}
setUpPlots();
if (pictures.length) setUpPictures();
