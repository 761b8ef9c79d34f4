//! How it scales: fitted exponents.

use super::super::ReportView;
use super::super::facts::{self, Exponent};
use super::super::format::{Table, si};
use super::claims::plot;
use super::cut;
use fathom_base::text;

const MOST_ROWS: usize = 26;

pub fn write(view: &ReportView<'_>, text: &mut String) {
    let (exponents, more) = cut(facts::exponents(view), MOST_ROWS);
    let head = "plot|what|over|exponent (interval)|range|cells";
    let mut table = Table::new(head.split('|'));
    exponents.iter().for_each(|exponent| table.row_of_markdown(row(exponent)));
    let about = "Exponents b of y ∝ xᵇ, fitted to the cells whose fixed cost is at most a tenth of the time: 1 is linear. The \
                 interval is that of 95 % over the rounds of sampling, or the extremes with one cell left out where figures are exact.";
    table.add_to(text, &format!("## How it scales\n\n{about}{more}\n\n"));
}

fn row(exponent: &Exponent<'_, '_>) -> [String; 6] {
    let what = match exponent.group.as_str() {
        "" => exponent.y_title(),
        group => format!("{} ({group})", exponent.y_title()),
    };
    let (low, high) = exponent.fit.range;
    [
        plot(exponent.section),
        text::markdown(&what),
        text::markdown(&exponent.x_title()),
        exponent.text(),
        format!("{} – {}", si(low), si(high)),
        exponent.fit.slope.n.to_string(),
    ]
}
