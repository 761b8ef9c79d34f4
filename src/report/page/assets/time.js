/* Where the time goes: bars in per cent or ms, and the stages of any frame of any cell. */
{
  const stacks = fathom.all("#time-frames .stack");
  const longest = Math.max(...stacks.map((stack) => Number(stack.dataset.ms)));
  const unit = document.getElementById("time-unit");
  unit?.addEventListener("change", () => {
    stacks.forEach((stack) => {
      stack.style.width = unit.value === "ms" ? `${(100 * Number(stack.dataset.ms)) / longest}%` : "";
    });
  });

  const step = (name, start, length, text, color) => {
    const track = fathom.element("span", { class: "step-track" });
    if (length > 0) {
      const bar = fathom.element("span", { class: "step-bar mark", "data-tip": `${name}: ${text}` });
      bar.style.setProperty("--start", start);
      bar.style.setProperty("--length", length);
      bar.style.background = color;
      track.append(bar);
    }
    return fathom.element("li", {},
      fathom.element("span", { class: "step-name" }, name), track,
      fathom.element("span", { class: "step-time" }, text));
  };

  /* The stages of a frame one after the other, then the sum of its gaps. */
  const steps = (cell, frame, colors) => {
    const time = (stage) => (stage.below === undefined ? stage.samples[frame] ?? 0 : 0);
    const gaps = Math.max(cell.gaps[frame] ?? 0, 0);
    const whole = cell.stages.reduce((sum, stage) => sum + time(stage), gaps);
    const share = (ms) => (whole > 0 ? (100 * ms) / whole : 0);
    let end = 0;
    const lines = cell.stages.map((stage) => {
      const ms = time(stage);
      const text = stage.below === undefined ? `${fathom.three(ms)} ms` : `< ${fathom.three(stage.below)} ms`;
      const line = step(stage.stage, share(end), share(ms), text, colors[stage.stage]);
      end += ms;
      return line;
    });
    lines.push(step("gaps between passes", share(end), share(gaps), `${fathom.three(gaps)} ms`, "var(--rule)"));
    return lines;
  };

  const clocks = (stages) => {
    const names = new Map();
    stages.forEach(({ stage, clock }) => names.set(clock, [...(names.get(clock) ?? []), stage]));
    const told = [...names].sort((a, b) => b[1].length - a[1].length)
      .map(([clock, of]) => `${clock} (${of.length > 3 ? `${of.length} stages` : of.join(", ")})`);
    return `Clocks: ${told.join("; ")}.`;
  };

  const waterfall = document.getElementById("waterfall");
  const choice = document.getElementById("waterfall-cell");
  const slider = document.getElementById("waterfall-frame");
  const zoom = document.getElementById("waterfall-zoom");
  const from = document.getElementById("waterfall-from");
  /* The part of the frame that is shown. */
  const look = () => {
    const factor = 2 ** Number(zoom.value);
    const first = (Number(from.value) / 100) * (100 - 100 / factor);
    waterfall.style.setProperty("--zoom", factor);
    waterfall.style.setProperty("--from", first);
    document.getElementById("waterfall-shown").textContent =
      `${fathom.three(first)} to ${fathom.three(first + 100 / factor)} % of the frame`;
  };
  const start = async () => {
    const { runs, colors } = await fathom.data();
    const timed = runs.flatMap((run) => run.cells.filter((cell) => cell.untimed.length > 0).map((cell) => ({ run, cell })));
    const first = timed.findIndex(({ run, cell }) => run.label === waterfall.dataset.run
      && cell.experiment === waterfall.dataset.experiment && cell.cell === waterfall.dataset.cell);

    const show = () => {
      const { run, cell } = timed[Number(choice.value)];
      const frame = Number(slider.value);
      const of = runs.length > 1 ? ` on ${run.label}` : "";
      const at = cell.at_s[frame] === undefined ? "" : `, taken ${cell.at_s[frame]} s after the first of the run`;
      document.getElementById("waterfall-about").textContent =
        `${cell.experiment}, ${cell.cell}${of}: frame ${frame + 1} of ${cell.envelope.length}${at}. ${clocks(cell.stages)}`;
      slider.setAttribute("aria-valuetext", `frame ${frame + 1} of ${cell.envelope.length}`);
      waterfall.replaceChildren(...steps(cell, frame, colors));
    };
    const groups = new Map();
    timed.forEach(({ run, cell }, place) => {
      const name = runs.length > 1 ? `${cell.experiment} on ${run.label}` : cell.experiment;
      if (!groups.has(name)) groups.set(name, fathom.element("optgroup", { label: name }));
      groups.get(name).append(fathom.element("option", { value: place }, cell.cell));
    });
    choice.append(...groups.values());
    choice.value = String(Math.max(first, 0));
    slider.max = timed[Number(choice.value)].cell.envelope.length - 1;
    slider.value = waterfall.dataset.frame;
    choice.disabled = slider.disabled = false;
    choice.addEventListener("change", () => {
      slider.max = timed[Number(choice.value)].cell.envelope.length - 1;
      slider.value = 0;
      show();
    });
    slider.addEventListener("input", show);
    [zoom, from].forEach((control) => control.addEventListener("input", look));
    [choice, slider].forEach((control) => { control.dataset.first = control.value; });
    fathom.restore();
  };
  if (waterfall) addEventListener("load", () => setTimeout(start));
}
