//! What a frame is made of: stages, and what they leave behind.

use glam::DVec3;

use fathom_clock::{StageScope, TimedStage};
use fathom_record::Work;

/// A timed unit of a pipeline.
pub trait Stage {
    fn info(&self) -> &'static StageInfo;
    /// The name under which the time is recorded, such as `caustics/trace`.
    fn name(&self) -> &'static str {
        self.info().name
    }
    /// Opens the stage's passes. Called once per frame, or once for each of its [`turns`](Self::turns).
    fn encode(&self, scope: &mut StageScope<'_>);
    /// How often the stage is encoded in a frame. Neighbours with the same number of turns, more than one, take them together: all of
    /// them the first turn, then all the second, as stages do that share a target too small for the whole.
    fn turns(&self) -> u32 {
        1
    }
    /// Work of one frame, from the algorithm.
    fn work(&self) -> Work {
        Work::default()
    }
    /// What the stage does at least in a frame, for comparison with the adapter's limits. To be given where [`work`](Self::work) is an
    /// estimate or an upper bound, because the work depends on the data; where it counts a byte more than once; and where a compute
    /// pass does what a rasterizer else would.
    fn least_work(&self) -> Work {
        self.work()
    }
    /// What the stage leaves behind, for read-back and analysis.
    fn outputs(&self) -> Vec<Output> {
        Vec::new()
    }
}

impl TimedStage for dyn Stage + '_ {
    fn name(&self) -> &'static str {
        Stage::name(self)
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        Stage::encode(self, scope);
    }

    fn turns(&self) -> u32 {
        Stage::turns(self)
    }
}

/// One output of a stage, described for analysis elsewhere.
pub struct Output {
    /// File stem of a dump.
    pub name: String,
    pub meaning: String,
    /// One per channel of a texture or float of a buffer's element.
    pub columns: Vec<Column>,
    pub data: OutputData,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Column {
    pub name: &'static str,
    pub unit: &'static str,
    pub meaning: &'static str,
}

pub enum OutputData {
    /// `count` elements of `stride_floats` 32-bit floats; `row` makes an element's columns of them.
    Buffer {
        buffer: wgpu::Buffer,
        stride_floats: u32,
        count: u32,
        row: ReadRow,
    },
    Texture(wgpu::Texture),
    /// One level of a 3-D texture, whose cell (i, j, k) has its centre at
    /// `origin_m + spacing_m · (i + ½, j + ½, k + ½)`.
    Volume {
        texture: wgpu::Texture,
        level: u32,
        /// The corner of smallest coordinates, metres.
        origin_m: DVec3,
        /// Edges of a cell of this level, metres.
        spacing_m: DVec3,
    },
}

/// Makes the columns of an output from the floats of one element.
pub type ReadRow = Box<dyn Fn(&[f32]) -> Vec<f32>>;

/// What `fathom list stages` says of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageInfo {
    pub name: &'static str,
    pub about: &'static str,
    /// Paper and section.
    pub source: &'static str,
}

impl Column {
    pub const fn new(name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self { name, unit, meaning }
    }

    /// Red, green, blue and alpha of a picture.
    pub fn display(meaning: &'static str) -> Vec<Self> {
        ["red", "green", "blue", "alpha"].map(|name| Self::new(name, "1", meaning)).to_vec()
    }
}

impl Output {
    pub fn texture(
        name: &str,
        meaning: impl Into<String>,
        columns: Vec<Column>,
        texture: &wgpu::Texture,
    ) -> Self {
        let data = OutputData::Texture(texture.clone());
        Self { name: name.into(), meaning: meaning.into(), columns, data }
    }

    /// The final image of a pipeline.
    pub fn image(texture: &wgpu::Texture) -> Self {
        let columns = Column::display("display value, gamma 2.2");
        Self::texture("image", "the final image", columns, texture)
    }
}

impl StageInfo {
    /// Of a stage that is listed nowhere: of a test, an audit or an example.
    pub const fn unlisted(name: &'static str) -> Self {
        Self { name, about: "", source: "" }
    }
}
