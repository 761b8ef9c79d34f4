//! The HTML page in a real browser: no errors, what a reader clicks and types, all widths and modes, accessibility, hostile
//! names.

pub mod browser;
mod charts;

use std::path::{Path, PathBuf};

use crate::common::{Ends, Place, SMALL, hostile, lines, reference, reference_of};
use crate::stored::{COMPOSE, Stored, TRACE};
use browser::{Browser, Display, NARROW, WIDE, axe};
use fathom::record::Record;
use itertools::iproduct;
use serde_json::{Value, json};

/// Cells of the large page.
const MANY: usize = 2_000;

/// A folder with these records and the page that is made from them.
fn page_of(records: &str) -> (Place, PathBuf) {
    let place = Place::new();
    place.write("records.jsonl", records);
    place.fathom("report .").ends(0);
    let page = place.path("index.html");
    (place, page)
}

/// The reference run's cells over and over under new names, up to [`MANY`].
fn many() -> String {
    let is_cell = |record: &Record| matches!(record, Record::Cell(_));
    let (cells, mut others): (Vec<_>, Vec<_>) = reference_of("").into_iter().partition(is_cell);
    let end = others.pop();
    let copies = (0..MANY).map(|number| {
        let mut record = cells[number % cells.len()].clone();
        let (cell, copy) = (record.try_as_cell_mut().unwrap(), number / cells.len());
        cell.cell += &format!(",copy={copy}");
        cell.axes.insert("copy".to_owned(), copy.into());
        record
    });
    lines(others.into_iter().chain(copies).chain(end))
}

/// Runs a test in a browser.
fn in_browser(test: impl FnOnce(&Browser)) {
    let browser = Browser::open();
    test(&browser);
    browser.close();
}

/// One page and one browser for all: the start of each takes seconds.
#[test]
fn the_page_of_the_reference_run() {
    let (_folder, page) = page_of(&reference());
    in_browser(|browser| {
        opens_and_can_be_read(browser, &page);
        the_first_screen_answers_each_question_and_links_to_its_section(browser, &page);
        what_a_reader_filters_stays_in_the_address(browser, &page);
        cells_are_sorted_filtered_and_opened(browser, &page);
        values_are_shown_under_the_pointer_and_by_the_arrow_keys(browser, &page);
        print_shows_everything_but_the_controls(browser, &page);
        axe_finds_what_is_put_in(browser, &page);
        charts::can_be_read(browser, &page);
    });
}

/// A phone, a laptop and a desk: light, dark and printed.
const WIDTHS_PX: [u32; 3] = [390, 1280, 1920];

fn opens_and_can_be_read(browser: &Browser, page: &Path) {
    let axe = axe();
    for (width_px, dark, print) in iproduct!(WIDTHS_PX, [false, true], [false, true]) {
        let display = Display { width_px, dark, print };
        browser.show(page, display);
        assert_eq!(browser.console(), Vec::<String>::new(), "{page:?}, {display:?}");
        fits(browser, display);
        unfold(browser);
        fits(browser, display);
        assert_eq!(charts::faults(browser), json!([]), "{page:?}, {display:?}");
        let found = if print { json!([]) } else { serious(browser, &axe) };
        assert_eq!(found, json!([]), "{page:?}, {display:?}");
    }
}

/// Opens everything that is folded.
fn unfold(browser: &Browser) {
    browser
        .eval("document.querySelectorAll('details').forEach((folded) => { folded.open = true; })");
}

/// A laptop's window, without the browser's own bars.
const SCREEN_PX: u64 = 900;

fn the_first_screen_answers_each_question_and_links_to_its_section(browser: &Browser, page: &Path) {
    browser.show(page, WIDE);
    let cards = browser.eval(
        "return [...document.querySelectorAll('#overview .card')].map((card) => {
           const link = card.querySelector('h3 a');
           const section = document.querySelector(link.getAttribute('href'));
           return [card.getBoundingClientRect().bottom, card.textContent.length - link.textContent.length,
                   Boolean(section.querySelector(':scope > details:not([open])'))];
         })",
    );
    let cards = cards.as_array().unwrap();
    assert_eq!(cards.len(), 5);
    let drawings =
        browser.eval("return document.querySelectorAll('#overview .card :is(svg, .bars)').length");
    assert_eq!(drawings, 2, "stages of each pipeline, and the only experiment that scales");
    for card in cards {
        assert!(card[0].as_f64().unwrap() < SCREEN_PX as f64, "below the first screen: {card}");
        assert!(card[1].as_u64().unwrap() > 20, "no answer: {card}");
        assert_eq!(card[2], true, "the section is folded until it is asked for");
    }
    let opened = browser.eval_later(
        "const done = arguments[arguments.length - 1];
         addEventListener('hashchange', () => setTimeout(() => done(document.querySelector('#claims > details').open)));
         document.querySelector('#overview .card a[href=\"#claims\"]').click();",
    );
    assert_eq!(opened, true);
    let height = "return document.documentElement.scrollHeight";
    for (display, most_px) in [(WIDE, 2 * SCREEN_PX), (NARROW, 4_000)] {
        browser.show(page, display);
        let px = browser.eval(height).as_u64().unwrap();
        assert!(px <= most_px, "{display:?}: {px} px long");
    }
}

fn what_a_reader_filters_stays_in_the_address(browser: &Browser, page: &Path) {
    browser.show_at(page, "#cells?cell-experiment=uw-photons&cell-words=245", WIDE);
    let shown = "const rows = [...document.querySelectorAll('#cell-table tbody tr')];
                 return [document.querySelector('#cells > details').open, rows.length > 0,
                         rows.every((row) => row.dataset.experiment === 'uw-photons' && row.textContent.includes('245'))]";
    assert_eq!(browser.eval(shown), json!([true, true, true]));
    browser.show_at(page, "#claims?claim-words=uw-photons", WIDE);
    let claims = "return [...document.querySelectorAll('#claims table.claims > tbody > tr')]
                    .filter((row) => row.getClientRects().length > 0).map((row) => row.querySelector('.source').textContent)";
    let shown = browser.eval(claims);
    let shown = shown.as_array().unwrap();
    assert!(!shown.is_empty() && shown.iter().all(|id| id == "uw-photons"), "{shown:?}");
    browser.show(page, WIDE);
    browser.eval("document.querySelector('#cells > details').open = true; document.getElementById('cell-words').focus()");
    browser.devtools("Input.insertText", json!({ "text": "dragon" }));
    assert_eq!(browser.eval("return location.hash"), "#cells?cell-words=dragon");
}

/// Nothing but what scrolls by itself is wider than the window, and no type is smaller than 12 px.
fn fits(browser: &Browser, display: Display) {
    let wide = browser.eval("return document.documentElement.scrollWidth - innerWidth");
    assert!(wide.as_f64().unwrap() <= 0.0, "{display:?}: {wide} px too wide");
    let small = browser
        .eval(
            "const small = new Set();
             const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
             while (texts.nextNode()) {
               const holder = texts.currentNode.parentElement;
               if (!texts.currentNode.textContent.trim() || ['SCRIPT', 'STYLE'].includes(holder.tagName)) continue;
               const box = holder.getBoundingClientRect();
               const svg = holder.closest('svg');
               const scale = svg?.viewBox.baseVal?.width ? svg.getBoundingClientRect().width / svg.viewBox.baseVal.width : 1;
               const size = parseFloat(getComputedStyle(holder).fontSize) * (scale || 1);
               if (box.width > 0 && size < 11.99) small.add(`${holder.tagName} ${holder.textContent.slice(0, 40)} ${size}`);
             }
             return [...small].slice(0, 5)",
        );
    // Charts are scaled to the paper, where a pixel is smaller.
    assert!(display.print || small == json!([]), "{display:?}: {small}");
}

fn cells_are_sorted_filtered_and_opened(browser: &Browser, page: &Path) {
    browser.show(page, WIDE);
    browser.eval("document.getElementById('cell-more').click()");
    let frames =
        "return [...document.querySelectorAll('#cell-table tbody tr')].map((row) => row.cells[2])
        .filter((cell) => cell.dataset.v).map((cell) => Number(cell.dataset.v))";
    let click = "[...document.querySelectorAll('#cell-table th button')].find((button) => button.textContent.startsWith('Frame')).click();";
    let before = numbers(&browser.eval(frames));
    assert!(!before.is_sorted(), "the plan's order is not that of the times");
    let rising = numbers(&browser.eval(&format!("{click} {frames}")));
    assert!(rising.is_sorted() && rising.len() == before.len());
    let falling = numbers(&browser.eval(&format!("{click} {frames}")));
    assert!(falling.is_sorted_by(|a, b| a >= b));
    // Rows without a time stay last, and buttons have no order.
    let ends = "const rows = [...document.querySelectorAll('#cell-table tbody tr')].map((row) => 'v' in row.cells[2].dataset);
                return [rows.indexOf(false) === rows.lastIndexOf(true) + 1, document.querySelector('#cell-table th.script-only button')]";
    assert_eq!(browser.eval(ends), json!([true, null]));

    let filtered = browser
        .eval(
            "const choice = document.getElementById('cell-experiment');
             choice.value = 'uw-photons'; choice.dispatchEvent(new Event('change'));
             const shown = [...document.querySelectorAll('#cell-table tbody tr')];
             return [shown.length, shown.every((row) => row.dataset.experiment === 'uw-photons'), document.getElementById('cell-count').textContent]",
        );
    assert_eq!(filtered[0], 11, "{filtered}");
    assert_eq!(filtered[1], true);
    assert!(filtered[2].as_str().unwrap().starts_with("11 of "), "{filtered}");

    let opened = browser
        .eval_later(
            "const done = arguments[arguments.length - 1];
             const table = document.getElementById('cell-table');
             const told = () => table.querySelector('tr.detail')?.textContent;
             const shown = () => told()?.includes('caustics/trace') && done(told());
             new MutationObserver(shown).observe(table, { childList: true, subtree: true, characterData: true });
             table.querySelector('tbody tr button.stages').click();
             shown();",
        );
    assert!(opened.as_str().is_some_and(|text| text.contains("caustics/trace")), "{opened}");
    assert_eq!(browser.console(), Vec::<String>::new());
}

fn numbers(values: &Value) -> Vec<f64> {
    values.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
}

fn values_are_shown_under_the_pointer_and_by_the_arrow_keys(browser: &Browser, page: &Path) {
    browser.show(page, WIDE);
    unfold(browser);
    let tip = browser.eval(
        "const mark = document.querySelector('[data-tip]');
             mark.dispatchEvent(new PointerEvent('pointerover', { bubbles: true }));
             const tip = document.getElementById('tip');
             return [tip.hidden, tip.textContent === mark.dataset.tip]",
    );
    assert_eq!(tip, json!([false, true]));
    let walked = browser
        .eval(
            "const chart = [...document.querySelectorAll('svg.fathom-chart')].find((chart) => chart.querySelectorAll('[data-tip]').length > 2);
             chart.focus();
             const press = (key) => chart.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true, cancelable: true }));
             const tip = document.getElementById('tip');
             const told = [];
             for (const key of ['ArrowRight', 'ArrowRight', 'ArrowLeft']) { press(key); told.push(tip.textContent); }
             press('Escape');
             return [told[0] !== told[1], told[0] === told[2], tip.hidden]",
        );
    assert_eq!(walked, json!([true, true, true]));
}

fn print_shows_everything_but_the_controls(browser: &Browser, page: &Path) {
    browser.show(page, Display { print: true, ..WIDE });
    let shown = browser.eval(
        "const visible = (element) => element.getClientRects().length > 0;
             return [[...document.querySelectorAll('nav, .controls, button.copy')].some(visible),
                     [...document.querySelectorAll('main > section')].every(visible)]",
    );
    assert_eq!(shown, json!([false, true]));
    let printed = browser.eval(
        "dispatchEvent(new Event('beforeprint'));
         return ['claims', 'cells'].map((id) => document.querySelector(`#${id} > details`).open)",
    );
    assert_eq!(printed, json!([true, false]));
}

fn axe_finds_what_is_put_in(browser: &Browser, page: &Path) {
    browser.show(page, WIDE);
    // An image without a text, and grey on grey.
    browser.eval(
        "document.querySelector('main').insertAdjacentHTML('afterbegin',
               '<img src=\"data:,\"><p style=\"color:#bbb;background:#fff\">faint words</p>')",
    );
    let found = serious(browser, &axe()).to_string();
    assert!(found.contains("image-alt") && found.contains("color-contrast"), "{found}");
}

/// Faults of axe-core's two gravest kinds, each with the first elements that have it.
fn serious(browser: &Browser, axe: &str) -> Value {
    let script = format!(
        "{axe};
         const done = arguments[arguments.length - 1];
         window.axe.run().then((results) => done(results.violations
           .filter((fault) => ['serious', 'critical'].includes(fault.impact))
           .map((fault) => [fault.id, fault.nodes.slice(0, 3).map((node) => node.html.slice(0, 200))])),
           (error) => done([String(error)]));"
    );
    browser.eval_later(&script)
}

/// The pages that commands write, with their pictures: where an experiment has one picture there is no slider.
#[test]
fn pages_with_pictures_sort_filter_slide_and_obey_keys() {
    let (place, sizes) = (Place::new(), "--set view.width=64 --set view.height=64");
    in_browser(|browser| {
        for (out, command, told) in [
            (
                "a",
                format!("run uw-default uw-waves --axis water=circular {SMALL}"),
                "51%Left: base. ",
            ),
            ("b", format!("run uw-default {SMALL}"), "51%Left: base. "),
            (
                "c",
                format!("sweep volume_ao --scene plane --axis ao.rays=4,8,16 {sizes}"),
                "51%Left: ",
            ),
        ] {
            place.fathom(format!("{command} --visits 1 --budget 10m --out {out}")).ends(0);
            let page = place.path(out).join("index.html");
            values_are_shown_under_the_pointer_and_by_the_arrow_keys(browser, &page);
            let seen = browser.eval(
                "const key = (selector) => { const one = document.querySelector(selector); one?.focus(); return one; };
                 key('#cell-table th button').click();
                 const sorted = document.querySelectorAll('#cell-table [aria-sort]').length;
                 const words = key('#cell-words');
                 words.value = 'no such cell'; words.dispatchEvent(new Event('input'));
                 return [sorted, document.getElementById('cell-count').textContent.slice(0, 5), Boolean(key('.slider input'))]",
            );
            assert_eq!(seen, json!([1, "0 of ", !told.is_empty()]), "{command}");
            let key =
                json!({ "type": "keyDown", "key": "ArrowRight", "windowsVirtualKeyCode": 39 });
            browser.devtools("Input.dispatchKeyEvent", key);
            let seen = browser.eval(
                "const slider = document.querySelector('.slider:has(input)');
                 return slider ? slider.querySelector('.edge').style.left + slider.querySelector('p').textContent : ''",
            );
            assert!(seen.as_str().unwrap().starts_with(told), "{command}: {seen}");
            assert_eq!(browser.console(), Vec::<String>::new(), "{command}");
        }
    });
}

/// Of stored records, so that no label depends on what was measured. Of the sweeps one has two axes.
#[test]
fn pages_of_sweeps_a_comparison_and_a_history_can_be_read() {
    let place = Place::new();
    let comparison = Stored::new(&[TRACE, COMPOSE]).same(COMPOSE).counts(TRACE, 1.061);
    comparison.times(TRACE, false, 1.05, 0.004).write(&place.path("compare"));
    let sweeps = reference().replace("\"toml\":\"", "\"toml\":\"knee_share = 0.1\\n");
    place.write("sweeps/records.jsonl", sweeps);
    place.fathom("report compare").ends(0);
    place.fathom("report sweeps").ends(0);
    let Record::Run(run) = &reference_of("")[0] else { panic!() };
    let (commit, begun) = (run.build.clone().unwrap().commit.unwrap(), &run.started_at);
    for number in 0..8 {
        let of_run = reference().replace(&commit, &format!("{number:040x}"));
        place.write("records.jsonl", of_run.replace(begun, &format!("203{number}{}", &begun[4..])));
        place.fathom("history add . --db runs.sqlite --branch b --machine m").ends(0);
    }
    place.fathom("history show --db runs.sqlite --out history").ends(0);
    in_browser(|browser| {
        for folder in ["compare", "sweeps", "history"] {
            opens_and_can_be_read(browser, &place.path(folder).join("index.html"));
        }
    });
}

#[test]
fn hostile_names_run_no_script() {
    let (_folder, page) = page_of(&hostile::records());
    in_browser(|browser| {
        browser.show(&page, WIDE);
        // A dialog that a name opens would make this fail.
        let found = browser
            .eval(
                "return [document.scripts.length, document.querySelectorAll('main script, main iframe, main object, main [onerror]').length,
                         document.body.textContent.includes('<script>alert(1)</script>')]",
            );
        assert_eq!(found, json!([2, 0, true]));
        assert_eq!(browser.console(), Vec::<String>::new());
        // The page's policy holds where escaping would not: an injected handler does not run.
        let ran = browser
            .eval_later(
                "const done = arguments[arguments.length - 1];
                 const image = document.createElement('div');
                 document.body.append(image);
                 window.done = () => done(true);
                 document.addEventListener('securitypolicyviolation', (event) => event.effectiveDirective.startsWith('script-src') && done(false));
                 image.innerHTML = '<img src=\"data:,x\" onerror=\"window.done()\">';",
            );
        assert_eq!(ran, false);
    });
}

#[test]
fn of_two_thousand_cells_the_first_are_shown_and_all_on_demand() {
    let (_folder, page) = page_of(&many());
    let bytes = std::fs::metadata(&page).unwrap().len();
    assert!(bytes < 5_000_000, "{bytes} bytes");
    in_browser(|browser| {
        browser.show(&page, WIDE);
        assert_eq!(browser.console(), Vec::<String>::new());
        let rows = "document.querySelectorAll('#cell-table tbody tr').length";
        assert_eq!(browser.eval(&format!("return {rows}")), 200);
        let all =
            browser.eval(&format!("document.getElementById('cell-more').click(); return {rows}"));
        assert_eq!(all, MANY);
    });
}
