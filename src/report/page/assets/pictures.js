/* Two pictures of an experiment at the same place, with a line between them that moves. */
{
  const chooser = (label, figures, chosen) => {
    const options = figures.map((figure, index) => fathom.element("option", { value: index },
      figure.querySelector(".caption").textContent));
    const select = fathom.element("select", {}, ...options);
    select.value = chosen;
    return [select, fathom.element("label", {}, `${label} `, select)];
  };

  const slider = (holder) => {
    const figures = fathom.all("figure", holder.parentElement);
    const [left, leftLabel] = chooser("Left", figures, 0);
    const [right, rightLabel] = chooser("Right", figures, 1);
    const under = fathom.element("img");
    const over = fathom.element("img");
    const edge = fathom.element("span", { class: "edge", "aria-hidden": "true" });
    const stage = fathom.element("div", { class: "two" }, under, over, edge);
    const range = fathom.element("input", { type: "range", min: 0, max: 100, value: 50, "aria-label": "Share of the left picture, per cent" });
    const told = fathom.element("p", { class: "faint" });

    const move = () => {
      over.style.clipPath = `inset(0 ${100 - range.value}% 0 0)`;
      edge.style.left = `${range.value}%`;
    };
    const copy = (image, select) => {
      const source = figures[select.value].querySelector("img");
      image.src = source.src;
      image.alt = source.alt;
      return source;
    };
    const show = () => {
      const source = copy(over, left);
      copy(under, right);
      /* Small pictures are enlarged; both fill the same box. */
      const width = Math.max(320, source.width);
      stage.style.width = `${width}px`;
      stage.style.aspectRatio = `${source.width} / ${source.height}`;
      /* What is folded has no inner text. */
      const words = (select) => fathom.all("figcaption > span", figures[select.value]).map((span) => span.textContent).join(". ");
      told.textContent = `Left: ${words(left)}\nRight: ${words(right)}`;
      move();
    };
    const drag = (event) => {
      if (event.buttons !== 1) return;
      const box = stage.getBoundingClientRect();
      range.value = Math.round(100 * (event.clientX - box.x) / box.width);
      move();
    };
    stage.addEventListener("pointerdown", drag);
    stage.addEventListener("pointermove", drag);
    range.addEventListener("input", move);
    left.addEventListener("change", show);
    right.addEventListener("change", show);
    holder.append(fathom.element("div", { class: "controls" }, leftLabel, rightLabel), stage, range, told);
    show();
  };

  /* A group of one picture has no slider. */
  fathom.all("details.pictures .slider").forEach((holder) => {
    const details = holder.closest("details");
    const build = () => { if (details.open && !holder.firstChild) slider(holder); };
    details.addEventListener("toggle", build);
    build();
  });
}
