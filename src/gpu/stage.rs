//! What a frame is made of: stages, and what they leave behind.

use std::ops::Deref;

use glam::DVec3;

use fathom_clock::{StageScope, TimedStage};
use fathom_record::Work;

/// A timed unit of a pipeline. `L` is what later stages take of it.
pub struct Stage<L = ()> {
    pub info: &'static StageInfo,
    /// Work of one frame, from the algorithm.
    pub work: Work,
    /// What the stage does at least in a frame, for comparison with the adapter's limits. See [`Self::with_min_work`].
    pub min_work: Work,
    /// What the stage leaves behind, for read-back and analysis.
    pub dumps: Vec<StageDump>,
    pub output: L,
    iterations: u32,
    spends_inputs: bool,
    encode: Box<dyn Fn(&mut StageScope<'_>)>,
}

impl Stage {
    /// `encode` opens the passes of a frame.
    pub fn new(
        info: &'static StageInfo,
        work: Work,
        encode: impl Fn(&mut StageScope<'_>) + 'static,
    ) -> Self {
        let encode = Box::new(encode);
        let (dumps, output) = (Vec::new(), ());
        let (iterations, spends_inputs) = (1, false);
        Self { info, work, min_work: work, dumps, output, iterations, spends_inputs, encode }
    }
}

impl<L> Stage<L> {
    /// The name under which the time is recorded, such as `caustics/trace`.
    pub fn name(&self) -> &'static str {
        self.info.name
    }

    /// To be given where the work is an estimate or an upper bound, because it depends on the data; where it counts a byte more than once;
    /// and where a compute pass does what a rasterizer else would.
    #[must_use]
    pub fn with_min_work(self, min_work: Work) -> Self {
        Self { min_work, ..self }
    }

    /// Encoded so often in a frame. Neighbours with the same number of turns, more than one, take them together: all of them the first
    /// turn, then all the second, as stages do that share a target too small for the whole.
    #[must_use]
    pub fn with_iterations(self, iterations: u32) -> Self {
        Self { iterations, ..self }
    }

    /// Whether a frame leaves its inputs with less work, so that it cannot be repeated alone: see [`stages_before`].
    #[must_use]
    pub fn with_spent_inputs(self, spends_inputs: bool) -> Self {
        Self { spends_inputs, ..self }
    }

    #[must_use]
    pub fn dump(self, output: StageDump) -> Self {
        self.dumps([output])
    }

    #[must_use]
    pub fn dumps(mut self, outputs: impl IntoIterator<Item = StageDump>) -> Self {
        self.dumps.extend(outputs);
        self
    }

    pub fn with_output<M>(self, left: M) -> Stage<M> {
        self.swap(left).0
    }

    /// The stage by itself, and what it leaves.
    pub fn split(self) -> (Stage, L) {
        self.swap(())
    }

    fn swap<M>(self, output: M) -> (Stage<M>, L) {
        let Self { info, work, min_work, dumps, output: before, iterations, spends_inputs, encode } =
            self;
        (Stage { info, work, min_work, dumps, output, iterations, spends_inputs, encode }, before)
    }
}

/// Of the stages of a frame those that must run before a stage is repeated alone: the earlier ones, if its inputs are spent.
pub fn stages_before<'a>(stages: &[&'a Stage], stage: &Stage) -> Vec<&'a Stage> {
    let earlier = stages.iter().copied().take_while(|earlier| earlier.name() != stage.name());
    earlier.filter(|_| stage.spends_inputs).collect()
}

impl Stage<wgpu::Texture> {
    pub fn texture(&self) -> &wgpu::Texture {
        &self.output
    }

    /// The texture is an output of these columns.
    #[must_use]
    pub fn dump_as(self, name: &str, meaning: &str, columns: Vec<Column>) -> Self {
        let output = StageDump::texture(name, meaning, columns, &self.output);
        self.dump(output)
    }

    /// The texture is the final image of a pipeline.
    #[must_use]
    pub fn image(self) -> Self {
        let image = StageDump::image(&self.output);
        self.dump(image)
    }
}

impl<L> Deref for Stage<L> {
    type Target = L;

    fn deref(&self) -> &L {
        &self.output
    }
}

impl<L> TimedStage for Stage<L> {
    fn name(&self) -> &'static str {
        self.info.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        (self.encode)(scope);
    }

    fn iterations(&self) -> u32 {
        self.iterations
    }
}

/// One output of a stage, described for analysis elsewhere.
pub struct StageDump {
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

    /// Columns of one unit and meaning.
    pub fn many<const N: usize>(
        names: [&'static str; N],
        unit: &'static str,
        meaning: &'static str,
    ) -> Vec<Self> {
        names.map(|name| Self::new(name, unit, meaning)).to_vec()
    }

    /// Red, green, blue and alpha of a picture.
    pub fn display(meaning: &'static str) -> Vec<Self> {
        Self::many(["red", "green", "blue", "alpha"], "1", meaning)
    }
}

impl StageDump {
    pub fn texture(
        name: &str,
        meaning: &str,
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

    /// `count` elements of so many 32-bit floats each; `row` makes an element's columns of them.
    pub fn rows(
        name: &str,
        meaning: &str,
        columns: Vec<Column>,
        (buffer, stride_floats, count): (&wgpu::Buffer, usize, u32),
        row: impl Fn(&[f32]) -> Vec<f32> + 'static,
    ) -> Self {
        let (buffer, stride_floats, row) = (buffer.clone(), stride_floats as u32, Box::new(row));
        let data = OutputData::Buffer { buffer, stride_floats, count, row };
        Self { name: name.into(), meaning: meaning.into(), columns, data }
    }
}
