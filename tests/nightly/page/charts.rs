//! Charts of the page and plots can be read: labels lie whole and apart.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::browser::{Browser, Display, WIDE};

/// Faults of all charts that are shown, in words.
const FAULTS: &str = r#"
    document.querySelectorAll('details').forEach((details) => { details.open = true; });
    const faults = [];
    const root = document.documentElement;
    const isShown = (element) => element.getClientRects().length > 0;
    const charts = root.tagName === 'svg' ? [root] : [...document.querySelectorAll('svg.fathom-chart')];
    const words = (element) => element.textContent.trim();
    const parts = (a, b) => [Math.min(a.right, b.right) - Math.max(a.left, b.left),
                             Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top)];
    const isOutside = (a, b) => a.left < b.left - 1 || a.right > b.right + 1 || a.top < b.top - 1 || a.bottom > b.bottom + 1;
    for (const chart of charts.filter(isShown)) {
      const told = (fault) => faults.push(`${chart.getAttribute('aria-label') ?? document.URL.split('/').pop()}: ${fault}`);
      const texts = [...chart.querySelectorAll('text')].filter((text) => words(text) && isShown(text));
      const boxes = texts.map((text) => text.getBoundingClientRect());
      const frame = chart.getBoundingClientRect();
      texts.forEach((text, index) => {
        if (words(text).endsWith('…')) told(`"${words(text)}" is cut`);
        if (isOutside(boxes[index], frame)) told(`"${words(text)}" lies outside`);
        texts.slice(0, index).forEach((other, before) => {
          const [across, down] = parts(boxes[index], boxes[before]);
          if (across > 1 && down > 2) told(`"${words(text)}" lies over "${words(other)}"`);
        });
      });
    }
"#;

pub fn faults(browser: &Browser) -> Value {
    browser.eval(&format!("{FAULTS} return faults"))
}

pub fn can_be_read(browser: &Browser, page: &Path) {
    what_must_be_found(browser);
    let of_plot = |plot: PathBuf| {
        browser.show(&plot, Display { width_px: 1000, ..WIDE });
        faults(browser).as_array().unwrap().clone()
    };
    let of_plots: Vec<Value> = plots(page).into_iter().flat_map(of_plot).collect();
    assert_eq!(of_plots, Vec::<Value>::new());
}

/// A label that is moved out of its chart, one on another, and one that is cut.
fn what_must_be_found(browser: &Browser) {
    browser.eval(
        "const [first, second, third] = document.querySelectorAll('svg.fathom-chart text');
         first.setAttribute('x', -500);
         second.after(second.cloneNode(true));
         third.textContent = 'sha…';",
    );
    let found = faults(browser).to_string();
    for fault in ["lies outside", "lies over", "is cut\""] {
        assert!(found.contains(fault), "{fault}: {found}");
    }
}

/// The plots beside the page.
fn plots(page: &Path) -> Vec<PathBuf> {
    let files = std::fs::read_dir(page.parent().unwrap()).unwrap();
    let files = files.map(|file| file.unwrap().path());
    let plots: Vec<PathBuf> =
        files.filter(|file| file.extension().is_some_and(|ending| ending == "svg")).collect();
    assert!(plots.len() > 3, "{plots:?}");
    plots
}
