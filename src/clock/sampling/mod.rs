//! What is sampled of a program: warm-up, pairs of frames, and the figures that follow from them.

mod figures;
mod samples;
mod warm_up;

pub use figures::{accounting_error, frame_record, sampling_notes, stage_record};
pub use samples::{FramePair, MAX_REJECTED_SHARE, MIN_JUDGED_FRAMES, Samples};
pub use warm_up::{MAX_WARM_UP_FRAMES, WARM_UP_TOLERANCE, WarmUp};
