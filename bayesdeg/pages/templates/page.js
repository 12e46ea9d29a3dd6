const cues = () => document.querySelectorAll(".cue").forEach((cue) => {
  const part = cue.nextElementSibling;
  cue.classList.toggle("shown", part.scrollWidth > part.clientWidth + 1);
});
addEventListener("load", cues);
addEventListener("resize", cues);
document.addEventListener("toggle", cues, true);
addEventListener("beforeprint", () => document.querySelectorAll("details:not([open])").forEach((part) => { part.open = true; part.dataset.closed = ""; }));
addEventListener("afterprint", () => document.querySelectorAll("details[data-closed]").forEach((part) => { part.open = false; delete part.dataset.closed; }));

const button = (name, label) => {
  const made = document.createElement("button");
  made.type = "button";
  made.className = name;
  made.textContent = label;
  return made;
};
const text = (row, column) => row.cells[column].innerText.trim();
const value = (words) => {
  const found = words.replace(/[−–]/g, "-").replace(/[\u202f\u00a0,]/g, "").match(/^[<>≤≥]?\s*([+-]?\d+\.?\d*(e[+-]?\d+)?)/i);
  return found ? Number(found[1]) : NaN;
};
const compared = (a, b) => {
  const [x, y] = [value(a), value(b)];
  return Number.isNaN(x) || Number.isNaN(y) ? Number.isNaN(x) - Number.isNaN(y) || a.localeCompare(b) : x - y;
};
const sort = (table, header) => {
  const upwards = header.getAttribute("aria-sort") !== "ascending";
  table.querySelectorAll("th[aria-sort]").forEach((other) => other.removeAttribute("aria-sort"));
  header.setAttribute("aria-sort", upwards ? "ascending" : "descending");
  const body = table.tBodies[0], column = header.cellIndex;
  const rows = [...body.rows].sort((a, b) => (upwards ? 1 : -1) * compared(text(a, column), text(b, column)));
  body.append(...rows);
};
const copy = (table, told) => {
  const rows = [...table.rows].map((row) => [...row.cells].map((cell) => cell.innerText.replace(/\s+/g, " ").trim()).join("\t"));
  const area = document.createElement("textarea");
  area.value = rows.join("\n");
  document.body.append(area);
  area.select();
  told.textContent = document.execCommand("copy") ? "copied" : "not copied";
  area.remove();
  told.focus();
};
document.querySelectorAll(".scroll table").forEach((table) => {
  const plain = table.tHead && table.tHead.rows.length === 1 && table.tBodies.length === 1
    && !table.querySelector("[rowspan], [colspan]") && table.tBodies[0].rows.length > 1;
  if (plain) [...table.tHead.rows[0].cells].filter((header) => header.innerText.trim()).forEach((header) => {
    const by = button("sort", "");
    by.append(...header.childNodes);
    by.addEventListener("click", () => sort(table, header));
    header.append(by);
  });
  const taken = button("copy", "copy");
  taken.setAttribute("aria-live", "polite");
  taken.addEventListener("click", () => copy(table, taken));
  (table.caption?.firstElementChild ?? table.caption)?.append(" ", taken);
});
