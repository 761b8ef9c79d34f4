//! How noisy a run or a comparison was, in words.

use itertools::Itertools;

use super::document::Tone;
use super::format::{percent, three, trim_zeros};
use fathom_judge::noise::TimeNoise;
use fathom_judge::run::{Advice, BoundedFigure, Criterion, Drift, MeanLoad, Noise, RunVerdict};
use fathom_judge::verdict::Verdicts;

pub fn tone(verdict: &RunVerdict) -> Tone {
    match verdict.noise {
        Noise::Quiet if verdict.is_precise() => Tone::Good,
        Noise::Quiet => Tone::Neutral,
        Noise::Drifting | Noise::Noisy => Tone::Open,
    }
}

/// `noisy run: frame times scatter by 8.42 % (bound 5 %); 7 % of 223 timed cells reached ±2 %`
pub fn headline(verdict: &RunVerdict) -> String {
    let RunVerdict { noise, cells, precise, target, .. } = verdict;
    let share = (100.0 * *precise as f64 / *cells as f64).round();
    let [.., scatter, _] = verdict.figures();
    let is_scatter_known = *noise == Noise::Quiet && scatter.value.is_finite();
    let figures = verdict.exceeded().chain(is_scatter_known.then_some(scatter));
    let reached = format!("{share} % of {cells} timed cells reached ±{}", short_percent(*target));
    let words = figures.map(|figure| bounded(&figure)).chain([reached]).join("; ");
    format!("{noise} run: {words}")
}

fn bounded(BoundedFigure { criterion, value, bound }: &BoundedFigure) -> String {
    let [value, bound] = [value.abs(), *bound].map(short_percent);
    let [before, after] = match criterion {
        Criterion::OtherProcesses => ["other processes took", " of the cores"],
        Criterion::Steal => ["steal time took", " of a core"],
        Criterion::Scatter => ["frame times scatter by", ""],
        Criterion::Drift => ["frame times drifted by", ""],
    };
    format!("{before} {value}{after} (bound {bound})")
}

fn short_percent(share: f64) -> String {
    format!("{} %", trim_zeros(&three(100.0 * share)))
}

/// What it was measured by: `half width of the median cell 3.6 %, scatter of one frame's time 8.4 %, …`
pub fn figures(verdict: &RunVerdict) -> String {
    let [half_width, scatter] = [verdict.half_width, verdict.scatter].map(percent);
    let load = match verdict.load {
        Some(MeanLoad { others, steal, cores }) => format!(
            "other processes {} of {cores} cores, steal time {} % of a core",
            three(others),
            three(100.0 * steal)
        ),
        None => "load and steal time not recorded".to_owned(),
    };
    let drift =
        verdict.drift.map_or_else(String::new, |of_run| format!(", drift {}", drift(&of_run)));
    format!(
        "half width of the median cell {half_width}, scatter of one frame's time {scatter}, {load}{drift}"
    )
}

/// `-3.90 % a minute (-4.20 to -3.60)`
pub fn drift(drift: &Drift) -> String {
    let in_percent = |share: f64| format!("{:+.2}", 100.0 * share);
    let interval = drift.per_minute.interval.map_or_else(String::new, |i| {
        format!(" ({} to {})", in_percent(i.low), in_percent(i.high))
    });
    format!("{} % a minute{interval}", in_percent(drift.per_minute.median))
}

/// For the terminal: the headline, the figures, what would make the next run better.
pub fn lines(verdict: &RunVerdict) -> Vec<String> {
    [headline(verdict), figures(verdict)].into_iter().chain(to_do(verdict)).collect()
}

pub fn to_do(verdict: &RunVerdict) -> Option<String> {
    let advice = verdict.advice().iter().map(advice).join("; ");
    (!advice.is_empty()).then(|| format!("to do: {advice}"))
}

fn advice(advice: &Advice) -> String {
    match advice {
        Advice::CloseOthers => "close other programs".to_owned(),
        Advice::UnsharedHost => "use a machine that does not share its host with others".to_owned(),
        Advice::QuieterMachine => "use a quieter machine".to_owned(),
        Advice::Drifted(change) => {
            let change = three(100.0 * change.abs());
            format!("do not compare times of early and late cells, which drifted by {change} %")
        }
        Advice::MoreSamples => "add samples: resume the run with --budget 10m".to_owned(),
    }
}

/// In one sentence, before any verdict; none where no times were to be judged.
pub fn describe_noise(verdicts: &Verdicts<'_>) -> Option<String> {
    let in_percent = |share: f64| format!("{:.1} %", 100.0 * share);
    Some(match TimeNoise::from_verdicts(verdicts)? {
        TimeNoise::Void(reason) => format!("times cannot be used: {reason}"),
        TimeNoise::TooFewLaunches { scatter } => format!(
            "too few launches to see a slowdown in half of the cells; those of the median cell scatter by {}",
            in_percent(scatter)
        ),
        TimeNoise::Judged { noise, scatter, visible } => format!(
            "{noise}: launches of the median cell scatter by {}; in half of the cells a slowdown below {} can go unseen",
            in_percent(scatter),
            in_percent(visible)
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_headline_has_the_figures_beyond_their_bounds() {
        let busy = |others, steal| Some(MeanLoad { others, steal, cores: 2 });
        for (noise, scatter, load, expected) in [
            (Noise::Quiet, 0.025, None, "quiet run: frame times scatter by 2.5 % (bound 5 %); "),
            (Noise::Noisy, 0.084, None, "noisy run: frame times scatter by 8.4 % (bound 5 %); "),
            (
                Noise::Noisy,
                0.025,
                busy(0.3, 0.02),
                "noisy run: other processes took 15 % of the cores (bound 10 %); steal time took 2 % of a core (bound 1 %); ",
            ),
        ] {
            let verdict = RunVerdict {
                noise,
                scatter,
                load,
                target: 0.02,
                cells: 9,
                precise: 3,
                half_width: 0.03,
                drift: None,
            };
            let end = "33 % of 9 timed cells reached ±2 %";
            assert_eq!(headline(&verdict), format!("{expected}{end}"));
        }
    }
}
