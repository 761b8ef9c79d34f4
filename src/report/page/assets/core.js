"use strict";
/* What the parts of the page share: the packed times, exact values under the pointer and from the keyboard, copying. */
const fathom = {};

fathom.all = (selector, from = document) => [...from.querySelectorAll(selector)];

/* An element with attributes and children; text stays text. */
fathom.element = (name, attributes = {}, ...children) => {
  const svg = ["svg", "g", "rect", "circle", "line", "path", "polyline", "text", "title"];
  const made = svg.includes(name) && attributes.svg !== false
    ? document.createElementNS("http://www.w3.org/2000/svg", name)
    : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key !== "svg" && value !== undefined) made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
};

/* The page's data, unpacked once, when first asked for. */
fathom.data = () => {
  fathom.unpacked ??= (async () => {
    const packed = document.getElementById("data").textContent;
    const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return JSON.parse(await new Response(stream).text());
  })();
  return fathom.unpacked;
};

/* A mark's title is what the pointer and the keyboard show: the browser would show it a second time. */
fathom.all("svg title").forEach((title) => {
  if (!title.parentElement.matches("svg")) title.parentElement.dataset.tip = title.textContent;
  title.remove();
});

{
  const tip = document.getElementById("tip");
  let shown = null;

  const hide = () => {
    if (shown) shown.classList.remove("at");
    shown = null;
    tip.hidden = true;
  };

  /* Shows a mark's value beside it. */
  const show = (mark) => {
    hide();
    shown = mark;
    mark.classList.add("at");
    tip.textContent = mark.dataset.tip;
    tip.hidden = false;
    const box = mark.getBoundingClientRect();
    const { width, height } = tip.getBoundingClientRect();
    const left = Math.min(Math.max(4, box.x + box.width / 2 - width / 2), innerWidth - width - 4);
    const above = box.y - height - 8;
    tip.style.left = `${left}px`;
    tip.style.top = `${above > 4 ? above : box.y + box.height + 8}px`;
  };

  document.addEventListener("pointerover", (event) => {
    const mark = event.target.closest?.("[data-tip]");
    if (mark) show(mark);
    else if (shown) hide();
  });

  /* A chart is one stop of the tab key; arrows walk over its marks. */
  fathom.all("svg.fathom-chart").filter((chart) => chart.querySelector("[data-tip]")).forEach((chart) => {
    chart.setAttribute("tabindex", "0");
    chart.setAttribute("role", "application");
    chart.setAttribute("aria-roledescription", "chart: arrow keys give the values");
  });

  /* So is the list of claims. */
  fathom.all("ul.marks").forEach((list) => {
    const links = fathom.all("a", list);
    links.slice(1).forEach((link) => { link.tabIndex = -1; });
    list.addEventListener("focusin", (event) => show(event.target));
    list.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!step) return;
      const at = links.indexOf(event.target);
      const next = links[(at + step + links.length) % links.length];
      [event.target.tabIndex, next.tabIndex] = [-1, 0];
      event.preventDefault();
      next.focus();
    });
  });

  document.addEventListener("keydown", (event) => {
    const chart = event.target.closest?.("svg.fathom-chart");
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (event.key === "Escape") hide();
    if (!chart || !step) return;
    const marks = fathom.all("[data-tip]", chart).filter((mark) => mark.getClientRects().length > 0);
    if (marks.length === 0) return;
    const at = marks.indexOf(shown);
    const next = at < 0 ? (step > 0 ? 0 : marks.length - 1) : (at + step + marks.length) % marks.length;
    event.preventDefault();
    show(marks[next]);
  });
  document.addEventListener("focusout", hide);
  addEventListener("scroll", hide, { passive: true });
}

/* Copies what a button carries. From disk some browsers refuse the clipboard; a hidden field works there. */
document.addEventListener("click", async (event) => {
  const button = event.target.closest?.("[data-copy]");
  if (!button) return;
  const copied = await navigator.clipboard?.writeText(button.dataset.copy).then(() => true, () => false);
  if (!copied) {
    const field = fathom.element("textarea", { readonly: "" });
    field.value = button.dataset.copy;
    document.body.append(field);
    field.select();
    document.execCommand("copy");
    field.remove();
  }
  const before = button.textContent;
  button.textContent = "copied";
  setTimeout(() => { button.textContent = before; }, 1200);
});

/* The address: #place?control=value&…, the place that is shown and what the reader chose. */
fathom.address = () => {
  const [place, query] = location.hash.slice(1).split("?");
  return [decodeURIComponent(place), new URLSearchParams(query)];
};
fathom.controls = () => fathom.all(".controls :is(select, input)[id]");

/* Keeps what the reader chose in the address, which can be shared; of controls that are not ready, what the address says. */
fathom.keep = (place) => {
  const [, before] = fathom.address();
  const chosen = new URLSearchParams(fathom.controls()
    .map((control) => [control.id, control.disabled ? before.get(control.id) : control.value, control.dataset.first])
    .filter(([, value, first]) => value !== null && value !== first)
    .map(([id, value]) => [id, value]));
  const query = chosen.toString();
  history.replaceState(null, "", `#${encodeURIComponent(place)}${query && `?${query}`}`);
};

/* A link to something folded opens it and what it lies in. */
fathom.open = () => {
  const [place] = fathom.address();
  const target = place && document.getElementById(place);
  if (!target) return;
  for (let outer = target; outer; outer = outer.parentElement) {
    if (outer instanceof HTMLDetailsElement) outer.open = true;
  }
  target.querySelectorAll(":scope > details.section").forEach((folded) => { folded.open = true; });
  target.scrollIntoView();
};

/* Sets the controls to what the address says, else keeps in the address what they are set to. */
fathom.restore = () => {
  const [place, chosen] = fathom.address();
  for (const [id, value] of chosen) {
    const control = fathom.controls().find((known) => known.id === id);
    if (!control || control.disabled || control.value === value) continue;
    control.value = value;
    control.dispatchEvent(new Event(control.matches("select") ? "change" : "input", { bubbles: true }));
  }
  if (place) fathom.keep(place);
  fathom.open();
};
addEventListener("hashchange", fathom.restore);

/* The sections that a reader of paper needs; longer ones are printed where they are open. */
addEventListener("beforeprint", () => fathom.all("details[data-print=true]").forEach((folded) => { folded.open = true; }));

/* In a narrow window a row of a table is a block, and each cell names its column. */
{
  fathom.nameCells = (table) => {
    const heads = table.tHead ? [...table.tHead.rows[0].cells].map((head) => head.textContent) : [];
    for (const row of table.tBodies[0]?.rows ?? []) {
      let column = 0;
      for (const cell of row.cells) {
        if (cell.colSpan === 1 && heads[column]) cell.dataset.head = heads[column];
        column += cell.colSpan;
      }
    }
  };
  const narrow = matchMedia("(max-width: 600px)");
  fathom.isNarrow = () => narrow.matches;
  const update = () => { if (narrow.matches) fathom.all("table").forEach(fathom.nameCells); };
  narrow.addEventListener("change", update);
  update();
}

document.documentElement.classList.add("scripted");
