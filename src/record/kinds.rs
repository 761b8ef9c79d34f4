//! Kinds of notes, pictures, rejected frames and profiles in records.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use strum::{Display, EnumMessage};

use fathom_base::private;

/// How large an experiment runs.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Display, Serialize, Deserialize, JsonSchema,
)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Profile {
    /// Scaled for a software driver on two cores.
    #[default]
    Quick,
    /// The published sizes.
    Paper,
}

impl Profile {
    pub const ALL: [Profile; 2] = [Profile::Quick, Profile::Paper];
}

/// Whether wgpu's bounds and loop checks are compiled into the shaders.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Display, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum ShaderChecks {
    #[default]
    Checked,
    Unchecked,
}

/// What else was in the command buffer of an audited pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Display, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Surrounding {
    Alone,
    /// Passes of the other kinds.
    Mixed,
}

/// What a run does besides rendering the frames that it measures.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Display, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "lowercase")]
pub enum SetUp {
    /// Opening the adapter.
    Device,
    /// Making scenes and resolving parameters.
    Scenes,
    /// The clock's audit.
    Audit,
    /// Measuring the adapter's limits.
    Ceilings,
    /// Building pipelines and their resources.
    Pipelines,
    /// Counting shader invocations.
    Counting,
    /// Reading figures back.
    Quantities,
    /// Errors against references.
    Errors,
    /// Runs that results are compared with: denser ones, and the same seen from elsewhere.
    Comparisons,
    Pictures,
    /// Writing reports while the run goes on.
    Reports,
}

/// How far a run is that goes on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunProgress {
    /// Since the command began, seconds.
    pub used_s: f64,
    /// For the whole command, seconds.
    pub budget_s: f64,
    /// With a record, a provisional one too.
    pub reached: usize,
    /// All that are chosen.
    pub cells: usize,
}

/// Something to know about a run or a cell.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Note {
    pub kind: NoteKind,
    /// For people.
    pub text: String,
}

impl Note {
    pub fn new(kind: NoteKind, text: impl Into<String>) -> Note {
        Note { kind, text: private::redact(&text.into()) }
    }
}

/// What a note is about.
// The page shows these comments.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema, EnumMessage,
)]
#[serde(rename_all = "snake_case")]
pub enum NoteKind {
    /// The adapter lacks a feature, or the environment changes how it works.
    Adapter,
    /// Of a run: in which order cells and frames were measured.
    Order,
    /// Of a run: passes are timed by another clock than its audit chose.
    OtherClocks,
    /// Of a run: the adapter's limits were not measured, as its budget is short.
    NoCeilings,
    /// Of a merged run: some of its cells have no record.
    Incomplete,
    /// The cell was written while it was measured: figures other than times are not read yet.
    Unfinished,
    /// The run was extended: some samples are of before.
    Resumed,
    /// The frame time still fell when warm-up was given up.
    Unsteady,
    /// Sampling stopped before the precision asked for was reached.
    Imprecise,
    /// Some frames were far slower or faster than the median.
    Outliers,
    /// Heat or power held the clocks down in some samples.
    Throttled,
    /// Pixels show more surfaces than there are layers of depth: rays miss those behind the last layer.
    LayersFull,
    /// A figure was not finite and is left out.
    NotFinite,
    /// A figure could not be computed.
    NotComputed,
    /// A picture could not be written.
    NoPicture,
}

/// A picture of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Picture {
    /// Within the folder of the records, its parts joined by `/`.
    pub path: String,
    pub shows: PictureKind,
    /// Where its colours are no light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<PictureScale>,
}

/// What the colours of a picture mean that shows no light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PictureScale {
    /// Grey is 1 − A for occlusion A: black is closed, white is open.
    Visibility,
    /// Occlusion less that of the reference, 0 … 1: red is too dark, blue is too light, white is right, grey is not compared.
    OcclusionError(ErrorSpan),
    /// Irradiance less that of the reference, in units of the reference's mean: red is too bright, blue is too dark, white is right.
    IrradianceError(ErrorSpan),
}

/// Errors of both signs that a picture's colours span.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct ErrorSpan {
    /// In full colour from this size on.
    pub full_at: f64,
    /// The size of the largest.
    pub largest: f64,
}

impl ErrorSpan {
    pub fn new(full_at: f64, errors: impl IntoIterator<Item = f64>) -> ErrorSpan {
        let sizes = errors.into_iter().map(f64::abs).filter(|size| size.is_finite());
        ErrorSpan { full_at, largest: sizes.fold(0.0, f64::max) }
    }
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PictureKind {
    /// The final image.
    Image,
    /// The difference from the reference.
    Error,
}

/// Why a timed frame was not used.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
pub struct Rejection {
    /// The stage, where it is one stage's fault.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stage: Option<String>,
    pub fault: FaultKind,
}

impl From<FaultKind> for Rejection {
    fn from(fault: FaultKind) -> Rejection {
        Rejection { stage: None, fault }
    }
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(stage) = &self.stage {
            write!(f, "{stage}: ")?;
        }
        f.write_str(self.fault.reason())
    }
}

/// What was wrong with a frame's times.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    Zero,
    Negative,
    /// Both timestamps are those of the frame before.
    Stale,
    LongerThanWall,
    /// The stage opened no pass, so there is nothing to time.
    NoPass,
    FrameNotPositive,
    UntimedNotPositive,
    StageNotPositive,
    OtherStages,
}

impl FaultKind {
    pub fn reason(self) -> &'static str {
        match self {
            Self::Zero => "zero duration",
            Self::Negative => "negative duration",
            Self::Stale => "stale timestamps",
            Self::LongerThanWall => "longer than the wall clock",
            Self::NoPass => "no pass",
            Self::FrameNotPositive => "frame time not positive",
            Self::UntimedNotPositive => "untimed frame time not positive",
            Self::StageNotPositive => "stage time not positive",
            Self::OtherStages => "stages differ from the first frame's",
        }
    }
}

/// So many timed frames were rejected for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RejectedFrames {
    #[serde(flatten)]
    pub rejection: Rejection,
    /// How many.
    pub frames: u32,
}
