//! One measured frame: which cell, and which of its samples.

use super::timed::cell_name;
use super::{Entry, ReportError, ReportView};
use fathom_base::statistics::nearest_to_median;
use fathom_base::text;
use fathom_record::{Measured, StageRecord};

/// What is asked for.
#[derive(Clone, Debug, Default)]
pub struct FrameChoice {
    /// `EXPERIMENT CELL`, or an experiment's id for its first timed cell; by default the first timed cell of all.
    pub cell: Option<String>,
    /// Counted from 0; by default the frame whose envelope is nearest to the median.
    pub frame: Option<usize>,
}

/// A frame of a cell. Samples of stages, gaps and envelope with the same index are of the same frame.
#[derive(Clone, Copy)]
pub struct ChosenFrame<'a> {
    pub entry: Entry<'a>,
    pub measured: &'a Measured,
    /// Of the frame's samples; every stage has so many.
    pub index: usize,
    /// Frames that the cell has.
    pub frames: usize,
}

impl ChosenFrame<'_> {
    /// Nanoseconds.
    pub fn stage_ns(&self, stage: &StageRecord) -> f64 {
        stage.samples_ns[self.index]
    }

    /// From the first stage's begin to the last stage's end, nanoseconds.
    pub fn envelope_ns(&self) -> f64 {
        self.measured.frame.envelope_samples_ns[self.index]
    }

    /// Time between stages, nanoseconds; below 0 where stages overlap.
    pub fn gaps_ns(&self) -> f64 {
        self.measured.frame.gap_samples_ns[self.index]
    }
}

impl<'a> ReportView<'a> {
    /// The frame that is asked for.
    pub fn frame(&self, choice: &FrameChoice) -> Result<ChosenFrame<'a>, ReportError> {
        let (entry, measured) = self.timed_cell(choice.cell.as_deref())?;
        let frames = frames(measured);
        let index = match choice.frame {
            None => nearest_to_median(&measured.frame.envelope_samples_ns[..frames]).unwrap_or(0),
            Some(index) if index < frames => index,
            Some(frame) => {
                let cell = cell_name(entry.cell);
                return Err(ReportError::UnknownFrame { cell, frame, last: frames - 1 });
            }
        };
        Ok(ChosenFrame { entry, measured, index, frames })
    }

    fn timed_cell(&self, name: Option<&str>) -> Result<(Entry<'a>, &'a Measured), ReportError> {
        let timed = self.entries().filter_map(|entry| Some((*entry, entry.cell.measured()?)));
        let mut timed = timed.filter(|(_, measured)| frames(measured) > 0).peekable();
        timed.peek().ok_or(ReportError::NoFrames)?;
        let Some(name) = name else { return timed.next().ok_or(ReportError::NoFrames) };
        let all: Vec<(Entry<'a>, &Measured)> = timed.collect();
        let named = all.iter().find(|(entry, _)| {
            cell_name(entry.cell) == name.trim() || entry.cell.experiment == name.trim()
        });
        named.copied().ok_or_else(|| {
            let names: Vec<String> = all.iter().map(|(entry, _)| cell_name(entry.cell)).collect();
            let nearest = text::nearest(name, names.iter().map(String::as_str));
            ReportError::UnknownCell { name: name.to_owned(), nearest }
        })
    }
}

/// Frames of which everything is there.
fn frames(measured: &Measured) -> usize {
    let of_frame = [&measured.frame.envelope_samples_ns, &measured.frame.gap_samples_ns];
    let of_stages = measured.stages.iter().map(|stage| &stage.samples_ns);
    of_frame.into_iter().chain(of_stages).map(Vec::len).min().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use fathom_base::statistics::median;
    use fathom_experiments::fixtures;

    fn choice(cell: Option<&str>, frame: Option<usize>) -> FrameChoice {
        FrameChoice { cell: cell.map(str::to_owned), frame }
    }

    #[test]
    fn a_frame_is_found_by_cell_experiment_and_number() {
        let view = testing::view();
        let default = view.frame(&FrameChoice::default()).unwrap();
        let envelopes = &default.measured.frame.envelope_samples_ns;
        // Fifteen samples: the median is one of them.
        assert_eq!(envelopes[default.index], median(envelopes));
        let last = view.timed().last().unwrap().0;
        let named = view.frame(&choice(Some(&cell_name(last)), Some(3))).unwrap();
        assert_eq!((named.entry.cell, named.index), (last, 3));
        let first = view.frame(&choice(Some("uw-photons"), None)).unwrap();
        assert_eq!(first.entry.cell.experiment, "uw-photons");
    }

    #[test]
    fn what_is_not_there_is_named() {
        let view = testing::view();
        let refused = |cell, frame| view.frame(&choice(cell, frame)).err().unwrap().to_string();
        let told = refused(Some("uw-photon"), None);
        assert!(told.starts_with("no timed cell `uw-photon`; did you mean `uw-photons "), "{told}");
        let told = refused(None, Some(15));
        assert!(told.contains("has frames 0 to 14, and no frame 15"), "{told}");
        let skipped = fixtures::all_skipped();
        let none = ReportView::new(&skipped, None).frame(&choice(None, None)).err().unwrap();
        assert!(none.to_string().contains("no cell with timed frames"), "{none}");
    }
}
