//! How noisy a run or a comparison was, in words.

use super::document::Tone;
use super::format::{percent, three, trim_zeros};
use fathom_judge::noise::TimeNoise;
use fathom_judge::run::{Advice, Drift, MeanLoad, Noise, RunVerdict};
use fathom_judge::verdict::Verdicts;

pub fn tone(verdict: &RunVerdict) -> Tone {
    match verdict.noise {
        Noise::Quiet if verdict.is_precise() => Tone::Good,
        Noise::Quiet => Tone::Neutral,
        Noise::Drifting | Noise::Noisy => Tone::Open,
    }
}

/// `noisy run: 7 % of 223 cells reached ±2 %`
pub fn headline(verdict: &RunVerdict) -> String {
    let RunVerdict { noise, cells, precise, target, .. } = verdict;
    let share = (100.0 * *precise as f64 / *cells as f64).round();
    let asked = three(100.0 * target);
    format!("{noise} run: {share} % of {cells} cells reached ±{} %", trim_zeros(&asked))
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

/// For the terminal and the summary: the headline, the figures, what would make the next run better.
pub fn lines(verdict: &RunVerdict) -> Vec<String> {
    let advice = verdict.advice().iter().map(advice).collect::<Vec<_>>().join("; ");
    let advice = (!advice.is_empty()).then(|| format!("to do: {advice}"));
    [headline(verdict), figures(verdict)].into_iter().chain(advice).collect()
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
