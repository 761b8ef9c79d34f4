//! How noisy a run or a comparison was, in words.

use itertools::Itertools;

use super::document::Tone;
use super::format::{percent, three, trim_zeros};
use fathom_judge::noise::TimeNoise;
use fathom_judge::run::{BoundedFigure, Criterion, MeanLoad, Noise, RunVerdict};
use fathom_judge::verdict::Verdicts;

pub fn tone(verdict: &RunVerdict) -> Tone {
    match verdict.noise {
        Noise::Quiet if verdict.has_intervals() => Tone::Good,
        Noise::Quiet => Tone::Neutral,
        Noise::Noisy => Tone::Open,
    }
}

/// `quiet run: frame times scatter by 1.31 % (bound 5 %); 54 of 63 timed cells have an interval`
pub fn headline(verdict: &RunVerdict) -> String {
    let RunVerdict { noise, cells, with_interval, seconds, .. } = verdict;
    let [.., scatter] = verdict.figures();
    let is_scatter_known = *noise == Noise::Quiet && scatter.value.is_finite();
    let figures = verdict.exceeded().chain(is_scatter_known.then_some(scatter));
    let is_told = *noise == Noise::Noisy && *with_interval > 0 && !verdict.is_short();
    let of_these = if is_told { ", of these minutes alone" } else { "" };
    let have = format!("{with_interval} of {cells} timed cells have an interval{of_these}");
    let short = verdict.is_short().then(|| {
        format!("within {seconds:.0} s: intervals are of these seconds alone and settle nothing")
    });
    let words = figures.map(|figure| bounded(&figure)).chain([have]).chain(short).join("; ");
    format!("{noise} run: {words}")
}

fn bounded(BoundedFigure { criterion, value, bound }: &BoundedFigure) -> String {
    let [value, bound] = [*value, *bound].map(short_percent);
    let [before, after, _] = words(*criterion);
    format!("{before} {value}{after} (bound {bound})")
}

/// Before and behind a figure, and what would make the next run better.
fn words(criterion: Criterion) -> [&'static str; 3] {
    match criterion {
        Criterion::OtherProcesses => {
            ["other processes took", " of the cores", "close other programs"]
        }
        Criterion::Steal => {
            let to_do = "use a machine that does not share its host with others";
            ["steal time took", " of a core", to_do]
        }
        Criterion::Scatter => ["frame times scatter by", "", "use a quieter machine"],
    }
}

fn short_percent(share: f64) -> String {
    format!("{} %", trim_zeros(&three(100.0 * share)))
}

/// What it was measured by: `half width of the median cell 3.6 %, scatter 8.4 %, …`
pub fn figures(verdict: &RunVerdict) -> String {
    let shares =
        [("half width of the median cell", verdict.half_width), ("scatter", verdict.scatter)];
    let known = shares.into_iter().filter(|(_, share)| share.is_finite());
    let load = match verdict.load {
        Some(MeanLoad { others, steal, cores }) => format!(
            "other processes {} of {cores} cores, steal time {} % of a core",
            three(others),
            three(100.0 * steal)
        ),
        None => "load and steal time not recorded".to_owned(),
    };
    known.map(|(what, share)| format!("{what} {}", percent(share))).chain([load]).join(", ")
}

/// For the terminal: the headline, the figures, what would make the next run better.
pub fn lines(verdict: &RunVerdict) -> Vec<String> {
    [headline(verdict), figures(verdict)].into_iter().chain(to_do(verdict)).collect()
}

pub fn to_do(verdict: &RunVerdict) -> Option<String> {
    // Others that use the machine explain a scatter.
    let of_cause = |(place, figure): (usize, BoundedFigure)| {
        (place == 0 || figure.criterion != Criterion::Scatter).then(|| words(figure.criterion)[2])
    };
    let causes = verdict.exceeded().enumerate().filter_map(of_cause);
    let visits = "add visits: --resume with a longer --budget, or a longer FrameClock::with_budget";
    let advice = causes.chain((!verdict.has_intervals()).then_some(visits)).join("; ");
    (!advice.is_empty()).then(|| format!("to do: {advice}"))
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
    fn a_verdict_names_the_figures_beyond_their_bounds_and_what_to_do() {
        let (half_width, cells, with_interval, seconds) = (0.03, 9, 3, 200.0);
        let load = Some(MeanLoad { others: 0.3, steal: 0.0, cores: 2 });
        let (noise, scatter) = (Noise::Noisy, 0.084);
        let verdict =
            RunVerdict { noise, cells, with_interval, half_width, scatter, seconds, load };
        let busy = "noisy run: other processes took 15 % of the cores (bound 10 %); ";
        let scatter = "frame times scatter by 8.4 % (bound 5 %); 3 of 9 timed cells have an interval, of these minutes alone";
        assert_eq!(headline(&verdict), format!("{busy}{scatter}"));
        assert!(to_do(&verdict).unwrap().starts_with("to do: close other programs; add visits"));
        let verdict = RunVerdict { load: None, ..verdict };
        assert_eq!(headline(&verdict), format!("noisy run: {scatter}"));
        assert!(to_do(&verdict).unwrap().starts_with("to do: use a quieter machine; add"));
        let short = headline(&RunVerdict { seconds: 41.0, ..verdict });
        assert!(short.contains("; within 41 s: intervals are of these seconds"), "{short}");
    }
}
