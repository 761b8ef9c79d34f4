/* Plots: drawn when their experiment is opened. */
{
  const draw = async (holder) => {
    if (holder.shadowRoot) return;
    const root = holder.attachShadow({ mode: "open" });
    const { runs } = await fathom.data();
    const run = runs.find((run) => run.label === holder.dataset.run);
    const plot = run?.plots.find((plot) => plot.name === holder.dataset.plot);
    if (!plot) return;
    const drawing = new DOMParser().parseFromString(plot.svg, "image/svg+xml");
    /* A root of its own keeps the drawing's style sheet from the page. */
    if (!drawing.querySelector("parsererror")) root.append(document.importNode(drawing.documentElement, true));
  };
  fathom.all("details.plot").forEach((details) => {
    const drawAll = () => details.open && fathom.all(".drawing", details).forEach(draw);
    details.addEventListener("toggle", drawAll);
    drawAll();
  });
}
