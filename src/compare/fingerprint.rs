//! What a configuration asks of the GPU, stage by stage: digests of wgpu's own trace.
//!
//! A trace has every object with its descriptor, every byte that is uploaded, every shader and every command that is submitted. It
//! names objects by their addresses. Here a name is replaced by a digest of what was made and of what it holds: a buffer or a texture
//! by its descriptor, its uploads and the stage that last wrote it; a view or a bind group by what it shows. So a stage's digest
//! differs where its own commands do, what they bind, or what any stage did before that these read.
//!
//! wgpu ignores every error of writing a trace. One that is not whole is an error here, never a digest.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;
use std::sync::LazyLock;

use itertools::chain;
use sha2::{Digest as _, Sha256};

use super::exact_gate::{ExactGateSide, both, reason};
use super::flow::Program;
use super::protocol::{
    Fingerprints, GateConfiguration, Greeting, Reply, StageFingerprint, WorkerRequest,
};
use super::worker_process::WorkerStart;
use fathom_record::comparison::{
    CellSubject, ChangedStage, Compared, Differs, ExactFigures, Side, UnchangedCells,
};

/// Lines of a difference that a record holds.
const MAX_DIFF_LINES: usize = 40;
/// Characters of a line of it.
const MAX_DIFF_CHARS: usize = 160;
/// Before the commands of a stage its name is submitted alone, behind this.
pub const STAGE_MARK: &str = "stage ";
/// What of them is written is known: targets, destinations, and bind groups.
const COMMANDS: [&str; 11] = [
    "RunComputePass",
    "RunRenderPass",
    "CopyBufferToBuffer",
    "CopyBufferToTexture",
    "CopyTextureToBuffer",
    "CopyTextureToTexture",
    "ClearBuffer",
    "ClearTexture",
    "PushDebugGroup",
    "PopDebugGroup",
    "InsertDebugMarker",
];
const POINTER: &str = "PointerId(";
const FILE: &str = "File(\"";

/// Why no cell can be taken for unchanged: something beside the cells differs that takes part in a measurement.
pub fn obstacle(programs: &[Program; 2], greetings: &[Greeting; 2]) -> Option<String> {
    let [base, head] = greetings;
    let differs = |what: &str| Some(format!("every cell is measured: {what} differs"));
    let starts = programs.each_ref().map(|program| &program.start);
    if base.measured_by.is_none() || head.measured_by.is_none() {
        return Some("every cell is measured: a build gives no fingerprints".to_owned());
    }
    if base.measured_by != head.measured_by {
        return differs("the clock, the worker or wgpu");
    }
    let with = |of: &Greeting| of.build.as_ref().map(|build| build.with.clone());
    if with(base) != with(head) {
        return differs("how the builds were made");
    }
    if base.adapter != head.adapter {
        return differs("the adapter or its driver");
    }
    let [base, head] = starts.map(|of: &WorkerStart| (&of.environment, of.gpu.to_args()));
    (base != head).then(|| differs("the environment"))?
}

/// Both programs do the same on the host: they are one file, or compiled of the same sources.
pub fn is_same_code(greetings: &[Greeting; 2], digests: &[String; 2]) -> bool {
    let [base, head] = greetings.each_ref().map(|of| of.host_code.as_ref());
    digests[0] == digests[1] || base.is_some() && base == head
}

/// What both sides' fingerprints of a configuration say: which cells ask the GPU for the same, with their declared work, and how the
/// others differ. What the host does is the same only in programs of the same code.
pub fn compare(
    builds: &mut [ExactGateSide<'_>; 2],
    configuration: &GateConfiguration,
    same_code: bool,
) -> Vec<Compared> {
    let request = WorkerRequest::Fingerprint { configuration: configuration.clone() };
    let mut line =
        UnchangedCells { configuration: configuration.id.clone(), cells: Vec::new(), reason: None };
    let [base, head] = match both(builds, &request) {
        [Ok(Reply::Fingerprint(base)), Ok(Reply::Fingerprint(head))] => [base, head],
        replies => {
            line.reason =
                replies.iter().find(|of| !matches!(of, Ok(Reply::Fingerprint(_)))).map(reason);
            return vec![Compared::Unchanged(line)];
        }
    };
    let mut lines = Vec::new();
    for cell in configuration.cells() {
        let (CellSubject::Stage(name) | CellSubject::Encode(name)) = cell.subject() else {
            let is_same = !base.created.is_empty() && base.created == head.created;
            line.cells.extend((is_same && same_code).then_some(cell));
            continue;
        };
        let sides = [&base, &head].map(|side| side.stages.iter().find(|stage| stage.name == name));
        let [Some(of_base), Some(of_head)] = sides else { continue };
        let is_same = !of_base.digest.is_empty() && of_base.digest == of_head.digest;
        if !cell.subject().is_stage() {
            line.cells.extend((is_same && same_code).then_some(cell));
        } else if is_same {
            lines.extend(Side::BOTH.into_iter().zip([of_base, of_head]).map(|(side, stage)| {
                let (work, counters) = (stage.work, BTreeMap::new());
                Compared::Exact(ExactFigures { side, cell: cell.clone(), work, counters })
            }));
            line.cells.push(cell);
        } else {
            let (differs, diff) = difference([of_base, of_head], [&base, &head]);
            lines.push(Compared::Changed(ChangedStage { cell, differs, diff }));
        }
    }
    lines.push(Compared::Unchanged(line));
    lines
}

/// In what a stage's fingerprints differ, and the lines that do.
fn difference(stages: [&StageFingerprint; 2], sides: [&Fingerprints; 2]) -> (Differs, String) {
    let [base, head] = stages;
    if base.shaders != head.shaders {
        let names: BTreeSet<&String> = stages.iter().flat_map(|stage| &stage.sources).collect();
        let texts = names.iter().map(|name| {
            let [base, head] = sides.map(|side| side.sources.get(*name).map_or("", |of| of));
            unified(name, base, head)
        });
        return (Differs::Shader, first_lines(&texts.collect::<String>()));
    }
    let of_commands = unified("commands", &base.commands, &head.commands);
    let differs = if of_commands.is_empty() { Differs::Inputs } else { Differs::Commands };
    (differs, first_lines(&of_commands))
}

/// Nothing where the texts are the same.
fn unified(name: &str, base: &str, head: &str) -> String {
    let [base_name, head_name] = ["a", "b"].map(|side| format!("{side}/{name}"));
    let diff = similar::TextDiff::from_lines(base, head);
    diff.unified_diff().header(&base_name, &head_name).to_string()
}

fn first_lines(text: &str) -> String {
    let more = text.lines().count().saturating_sub(MAX_DIFF_LINES);
    let short = |line: &str| line.chars().take(MAX_DIFF_CHARS).chain(['\n']).collect();
    let kept = text.lines().take(MAX_DIFF_LINES).map(short);
    let cut = (more > 0).then(|| format!("… and {more} lines more\n"));
    chain![kept, cut].collect()
}

/// Counts what wgpu's core warns of: what it cannot write into a trace it leaves out, and says so there alone.
struct WarningCounter;

thread_local! {
    static WARNINGS: Cell<u32> = const { Cell::new(0) };
}

impl log::Log for WarningCounter {
    fn enabled(&self, about: &log::Metadata<'_>) -> bool {
        about.level() <= log::Level::Warn && about.target().starts_with("wgpu_core")
    }

    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata()) {
            WARNINGS.set(WARNINGS.get() + 1);
        }
    }

    fn flush(&self) {}
}

/// What `record` gives.
///
/// # Errors
/// One line: wgpu has warned meanwhile, or a logger of the program's own would keep that from being known.
pub fn without_warnings<T>(record: impl FnOnce() -> T) -> Result<T, String> {
    static IS_OWN: LazyLock<bool> = LazyLock::new(|| {
        let is_own = log::set_logger(&WarningCounter).is_ok();
        log::set_max_level(log::max_level().max(log::LevelFilter::Warn));
        is_own
    });
    if !*IS_OWN {
        return Err("the program has a logger, so what wgpu warns of is not known".to_owned());
    }
    WARNINGS.set(0);
    let recorded = record();
    let warnings = WARNINGS.get();
    (warnings == 0).then_some(recorded).ok_or_else(|| "wgpu warned while it was written".to_owned())
}

/// What a trace says of a configuration.
#[derive(Debug, Default, PartialEq)]
pub struct Traced {
    pub stages: BTreeMap<String, TracedStage>,
    /// Digest of all that was made and uploaded before the first stage.
    pub created: String,
}

/// Its turns one after the other.
#[derive(Debug, Default, PartialEq)]
pub struct TracedStage {
    /// Of its work, which becomes that of what it wrote.
    works: Vec<String>,
    /// Of the shaders that it runs.
    shaders: BTreeSet<String>,
    /// Their labels.
    pub modules: BTreeSet<String>,
    /// Its commands and how what they use was made, for people.
    pub commands: String,
    /// Names in that text.
    names: HashMap<usize, String>,
}

impl TracedStage {
    /// Of its work on its inputs, and of its shaders.
    pub fn digests(&self) -> [String; 2] {
        [digest(&self.works), digest(&self.shaders)]
    }
}

/// # Errors
/// One line: the trace is not whole.
pub fn of_trace(folder: &Path) -> Result<Traced, String> {
    let path = folder.join("trace.ron");
    let text = std::fs::read_to_string(path).map_err(|error| format!("no trace: {error}"))?;
    let whole = text.strip_prefix("[\n").and_then(|text| text.strip_suffix(']'));
    let (objects, at) = (Vec::new(), HashMap::new());
    let (stages, created) = (BTreeMap::new(), Vec::new());
    let mut replay = Replay { folder, objects, at, stages, created, turn: None };
    for action in items(whole.ok_or("the trace does not end")?, 0) {
        if !action.trim_end().ends_with("),") {
            return Err("an action of the trace is cut short".to_owned());
        }
        replay.act(action)?;
    }
    replay.end_stage();
    Ok(Traced { stages: replay.stages, created: digest(replay.created) })
}

/// The items of a list whose lines are indented by so many spaces, each with all its lines.
fn items(text: &str, indent: usize) -> impl Iterator<Item = &str> {
    let begins = move |line: &str| {
        line.split_at_checked(indent).is_some_and(|(before, rest)| {
            before.trim().is_empty() && rest.starts_with(|first: char| first.is_ascii_uppercase())
        })
    };
    let mut rest = text;
    std::iter::from_fn(move || {
        let mut end = 0;
        for (number, line) in rest.split_inclusive('\n').enumerate() {
            if number > 0 && begins(line) {
                break;
            }
            end += line.len();
        }
        let (item, after) = rest.split_at(end);
        rest = after;
        (!item.trim().is_empty()).then_some(item)
    })
}

fn digest<T: AsRef<[u8]>>(parts: impl IntoIterator<Item = T>) -> String {
    let mut digest = Sha256::new();
    for part in parts {
        digest.update((part.as_ref().len() as u64).to_le_bytes());
        digest.update(part);
    }
    hex::encode(&digest.finalize()[..16])
}

/// What was made. Others are named by their places in the list of all, as an address is used again after a drop.
#[derive(Default)]
struct Object {
    /// Of how it was made, and of what it holds.
    digest: String,
    /// What it shows: a view's texture, a bind group's buffers and views.
    shows: Vec<usize>,
    /// Of these what a shader can write.
    writes: Vec<usize>,
    /// Bindings of a layout that a shader can write.
    writable: BTreeSet<u64>,
    is_view: bool,
    /// How it was made, and what that names in its order: itself, then others.
    made: String,
    others: Vec<usize>,
}

struct Replay<'a> {
    folder: &'a Path,
    objects: Vec<Object>,
    /// What stands at an address now.
    at: HashMap<u64, usize>,
    stages: BTreeMap<String, TracedStage>,
    /// What was made and uploaded before the first stage.
    created: Vec<String>,
    /// The stage whose turn it is, what it has done, and what it has written.
    turn: Option<(String, Vec<String>, Vec<usize>)>,
}

impl Replay<'_> {
    fn act(&mut self, action: &str) -> Result<(), String> {
        let (name, _) = action.split_once('(').ok_or("an action has no name")?;
        let addresses = addresses(action);
        if name.starts_with("Create") {
            let own = addresses.first().ok_or("a made object has no name")?;
            self.at.insert(*own, self.objects.len());
            self.objects.push(Object::default());
        }
        match name {
            "Submit" => self.submit(action)?,
            "WriteBuffer" | "WriteTexture" => {
                let text = self.replaced(action)?;
                self.turn.iter_mut().for_each(|(_, done, _)| done.push(text.clone()));
                self.create(&text);
                let target = self.at.get(addresses.first().unwrap_or(&0));
                let target = *target.ok_or("an upload to what was not made")?;
                self.objects[target].digest = digest([self.resolve(target), text]);
            }
            _ if name.starts_with("Create") => {
                let text = self.replaced(action)?;
                self.create(&text);
                let mut made = self.made(name, action, &text, &self.places_of(&addresses[1..]));
                made.others = self.places_of(&addresses);
                self.objects[self.at[&addresses[0]]] = made;
            }
            "Init" => {}
            _ if name.starts_with("Drop") || name.starts_with("Destroy") => {}
            other => return Err(format!("an action that is not known: {other}")),
        }
        Ok(())
    }

    fn create(&mut self, text: &str) {
        if self.stages.is_empty() && self.turn.is_none() {
            self.created.push(digest([text]));
        }
    }

    /// The places of what stands at these addresses.
    fn places_of(&self, addresses: &[u64]) -> Vec<usize> {
        addresses.iter().filter_map(|address| self.at.get(address).copied()).collect()
    }

    fn made(&self, name: &str, action: &str, text: &str, others: &[usize]) -> Object {
        let (digest, made) = (digest([text]), action.to_owned());
        let mut object = Object { digest, made, ..Object::default() };
        match name {
            "CreateBindGroupLayout" => {
                // What is not known to be read alone counts as written.
                const READ: [&str; 4] =
                    ["read_only: true", "Uniform", "ty: Texture(", "ty: Sampler("];
                let is_writable =
                    |(_, of): &(u64, &str)| !READ.iter().any(|read| of.contains(read));
                let written = bindings(action).into_iter().filter(is_writable);
                object.writable = written.map(|(binding, _)| binding).collect();
            }
            "CreateBindGroup" => {
                let layout = others.first().map(|layout| &self.objects[*layout]);
                for (binding, of) in bindings(action) {
                    let shown = self.places_of(&addresses(of));
                    if layout.is_none_or(|layout| layout.writable.contains(&binding)) {
                        object.writes.extend(&shown);
                    }
                    object.shows.extend(shown);
                }
            }
            "CreateTextureView" => (object.is_view, object.shows) = (true, others.to_vec()),
            _ => {}
        }
        object
    }

    /// The marks of stages, and what they submit.
    fn submit(&mut self, action: &str) -> Result<(), String> {
        let (_, list) = action.split_once('\n').unwrap_or_default();
        let commands: Vec<&str> = items(list, 4).collect();
        let marked = commands.iter().find_map(|of| of.trim().strip_prefix("InsertDebugMarker(\""));
        if let Some(mark) = marked.and_then(|mark| mark.strip_prefix(STAGE_MARK)) {
            self.end_stage();
            let name = mark.split('"').next().unwrap_or_default();
            self.turn = Some((name.to_owned(), Vec::new(), Vec::new()));
            return Ok(());
        }
        for command in commands {
            let name = command.trim_start().split(|c: char| !c.is_alphanumeric()).next();
            if !COMMANDS.contains(&name.unwrap_or_default()) {
                return Err(format!("a command that is not known: {}", name.unwrap_or_default()));
            }
            let text = self.replaced(command)?;
            let written = self.written(command);
            if let Some((stage, done, all)) = &mut self.turn {
                let mut of_stage = self.stages.remove(stage).unwrap_or_default();
                let used = addresses(command);
                let used: Vec<usize> =
                    used.iter().filter_map(|of| self.at.get(of).copied()).collect();
                describe(&self.objects, command, &used, &mut of_stage);
                self.stages.insert(stage.clone(), of_stage);
                done.push(text);
                all.extend(written);
            } else {
                // What is run once, when a configuration is made.
                self.write(&written, &text);
            }
        }
        Ok(())
    }

    /// Buffers and textures that a command may write.
    fn written(&self, command: &str) -> Vec<usize> {
        const TARGETS: [&str; 3] = ["view: PointerId(", "resolve_target: Some(PointerId(", "dst: "];
        // A depth that is only tested is read.
        let is_tested = |at: usize| {
            let mut next = command[at..].lines().skip(1).map(str::trim);
            [next.next(), next.next()] == [Some("depth: ReadOnly,"), Some("stencil: ReadOnly,")]
        };
        let behind = |field| {
            let places = command.match_indices(field).map(|(at, _)| at);
            let places = places.filter(|at| !is_tested(*at));
            let first = places.filter_map(|at| addresses(&command[at..]).first().copied());
            self.places_of(&first.collect::<Vec<_>>())
        };
        let groups = behind("bind_group: Some(");
        let of_groups = groups.into_iter().flat_map(|group| self.objects[group].writes.clone());
        let written = TARGETS.into_iter().flat_map(behind).chain(of_groups);
        written.map(|object| self.root(object)).collect()
    }

    /// From now on these hold what was written by work of this digest.
    fn write(&mut self, written: &[usize], work: &str) {
        for (place, object) in written.iter().enumerate() {
            self.objects[*object].digest = digest([work, &place.to_string()]);
        }
    }

    fn end_stage(&mut self) {
        let Some((name, done, written)) = self.turn.take() else { return };
        let work = digest(done);
        self.write(&written, &work);
        self.stages.entry(name).or_default().works.push(work);
    }

    /// The texture that a view is of, or the object itself.
    fn root(&self, object: usize) -> usize {
        match self.objects[object].shows.as_slice() {
            [texture] if self.objects[object].is_view => *texture,
            _ => object,
        }
    }

    /// What an object is, and what that shows now.
    fn resolve(&self, object: usize) -> String {
        let Object { digest: own, shows, .. } = &self.objects[object];
        digest(std::iter::once(own.clone()).chain(shows.iter().map(|of| self.resolve(*of))))
    }

    /// A text with digests in place of addresses and of files, without labels and the numbers of submissions.
    fn replaced(&self, text: &str) -> Result<String, String> {
        let is_label = |line: &&str| line.trim_start().starts_with("label: ");
        let mut lines = Vec::new();
        for line in text.lines().filter(|line| !is_label(line)) {
            let mut line = line.to_owned();
            for address in addresses(&line) {
                let object = self.at.get(&address).map(|object| self.resolve(*object));
                let name = format!("{POINTER}{address})");
                line = line.replace(&name, &object.ok_or("a command names what was not made")?);
            }
            if let Some((before, rest)) = line.split_once(FILE) {
                let (name, after) = rest.split_once('"').ok_or("a file has no name")?;
                let content = std::fs::read(self.folder.join(name));
                let content = content.map_err(|error| format!("{name}: {error}"))?;
                check_length(name, &content, text)?;
                line = format!("{before}{}{after}", digest([content]));
            }
            lines.push(line);
        }
        Ok(lines.join("\n"))
    }
}

/// Adds a text to a stage's commands, with names in place of addresses, and behind it how each object was made that it names first.
fn describe(objects: &[Object], text: &str, others: &[usize], stage: &mut TracedStage) {
    let mut new = Vec::new();
    let mut parts = text.split(POINTER);
    let mut named = parts.next().unwrap_or_default().to_owned();
    for (part, place) in parts.zip(others) {
        let kind = objects[*place].made.split('(').next().unwrap_or_default();
        let kind = kind.trim_start_matches("Create").trim_start_matches("General");
        let number = stage.names.len() + 1;
        let name = stage.names.entry(*place).or_insert_with(|| {
            new.push(*place);
            format!("{kind} {number}")
        });
        named += name;
        named += part.split_once(')').map_or("", |(_, after)| after);
    }
    stage.commands += named.trim_end();
    stage.commands += "\n";
    for place in new {
        let object = &objects[place];
        let label =
            object.made.split_once("label: Some(\"").and_then(|(_, of)| of.split('"').next());
        if object.made.starts_with("CreateShaderModule") {
            stage.shaders.insert(object.digest.clone());
            stage.modules.extend(label.map(str::to_owned));
        } else {
            describe(objects, &object.made, &object.others, stage);
        }
    }
}

/// The addresses in a text, in their order.
fn addresses(text: &str) -> Vec<u64> {
    let after = text.match_indices(POINTER).map(|(at, _)| &text[at + POINTER.len()..]);
    after.filter_map(|rest| rest.split(')').next()?.parse().ok()).collect()
}

/// Number and text of each entry of a bind group or of its layout.
fn bindings(action: &str) -> Vec<(u64, &str)> {
    let parts = action.split("binding: ").skip(1);
    parts.filter_map(|part| Some((number_after(part, "")?, part))).collect()
}

fn number_after(text: &str, field: &str) -> Option<u64> {
    let (_, rest) = text.split_once(field)?;
    let rest = rest.strip_prefix("Some(").unwrap_or(rest);
    rest.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}

/// A file may be cut short where a disk is full.
fn check_length(name: &str, content: &[u8], action: &str) -> Result<(), String> {
    let is_whole = if action.starts_with("WriteBuffer") {
        number_after(action, "size: ").is_some_and(|size| content.len() as u64 >= size)
    } else if action.starts_with("WriteTexture") {
        let [row, rows, depth] = ["bytes_per_row: ", "height: ", "depth_or_array_layers: "]
            .map(|field| number_after(action, field).unwrap_or(1));
        content.len() as u64 > row * (rows * depth).saturating_sub(1)
    } else {
        content.ends_with(b")") || content.ends_with(b"}")
    };
    is_whole.then_some(()).ok_or_else(|| format!("{name} is cut short"))
}

#[cfg(test)]
mod tests {
    use fathom_base::parameter::{self, ParamField};
    use fathom_gpu::{Gpu, Options, OutputData, Stage, read_buffer, read_texture, read_volume};
    use fathom_harness::catalog::Catalog;
    use fathom_harness::subject::{Subject, Subjects};
    use fathom_pipelines::KINDS;
    use fathom_pipelines::draw::{Random, near};
    use serde_json::{Value, json};

    use super::*;
    use crate::worker::fingerprint;

    /// Of a pipeline on a small picture.
    fn stages(pipeline: &str, sets: &[(&str, Value)]) -> BTreeMap<String, String> {
        let view = [("view.width", json!(32)), ("view.height", json!(24))];
        let sets = [&view[..], sets].concat();
        let sets: Vec<_> = sets.into_iter().map(|(path, value)| (path.to_owned(), value)).collect();
        let mut subjects = Subjects::new(&Catalog::builtin()).silent();
        let subject = subjects.subject(pipeline, "ball", &sets).unwrap();
        stages_of(&subject)
    }

    fn stages_of(subject: &Subject) -> BTreeMap<String, String> {
        let stages = fingerprint(&Options::default(), subject).unwrap().stages;
        stages.into_iter().map(|stage| (stage.name, stage.digest)).collect()
    }

    /// Over targets, storage buffers, copies, and work that is done once.
    #[test]
    fn a_change_is_seen_in_its_stage_and_in_those_that_read_what_it_leaves() {
        let small = |path, value| -> [(&str, Value); 1] { [(path, value)] };
        for (pipeline, path, values, expected) in [
            ("hsao", "filter.radius_px", [json!(4), json!(2)], "ao/compose hsao/filter"),
            ("hsao", "shadow.size", [json!(64), json!(128)], "ao/compose shadow/depth"),
            ("hsao", "hsao.steps", [json!(16), json!(15)], "ao/compose hsao/filter hsao/march"),
            ("hsao", "compose.show", [json!("image"), json!("occlusion")], "ao/compose"),
            ("hsao", "filter.taps", [json!(17), json!(17)], ""),
            (
                "underwater",
                "caustics.tolerance_m",
                [json!(0.001), json!(0.002)],
                "caustics/filter caustics/splat caustics/trace compose",
            ),
            (
                "volume_ao",
                "voxel.resolution",
                [json!(16), json!(17)],
                "ao/bilateral ao/compose ao/march voxel/clear voxel/overlap voxel/unpack",
            ),
        ] {
            let [base, head] = values.map(|value| stages(pipeline, &small(path, value)));
            let changed = head.iter().filter(|(name, of)| base.get(*name) != Some(*of));
            let changed: Vec<&str> = changed.map(|(name, _)| name.as_str()).collect();
            assert_eq!(changed.join(" "), expected, "{pipeline} {path}");
        }
    }

    /// By parameters that are uploads, sizes and states, and by the sources of a shader and of what it imports.
    #[test]
    fn what_differs_is_named_with_its_lines() {
        let prints = |sets: &[(&str, Value)]| {
            let view = [("view.width", json!(32)), ("view.height", json!(24))];
            let sets = [&view[..], sets].concat().into_iter();
            let sets: Vec<_> = sets.map(|(path, value)| (path.to_owned(), value)).collect();
            let mut subjects = Subjects::new(&Catalog::builtin()).silent();
            fingerprint(&Options::default(), &subjects.subject("hsao", "ball", &sets).unwrap())
                .unwrap()
        };
        let base = prints(&[]);
        let stage = |of: &Fingerprints, name: &str| {
            of.stages.iter().find(|stage| stage.name == name).unwrap().clone()
        };
        let told = |head: &Fingerprints, name: &str| {
            let [old, new] = [&base, head].map(|side| stage(side, name));
            difference([&old, &new], [&base, head])
        };
        let size = prints(&[("shadow.size", json!(512))]);
        let (differs, diff) = told(&size, "shadow/depth");
        assert_eq!(differs, Differs::Commands);
        for line in
            ["--- a/commands\n", "     label: Some(\"shadow/depth\"),\n", "+        width: 512,\n"]
        {
            assert!(diff.contains(line), "{diff}");
        }
        let radius = prints(&[("filter.radius_px", json!(2))]);
        assert_eq!(told(&radius, "hsao/filter"), (Differs::Inputs, String::new()));
        // Another shader, of which a module's line differs.
        let mut other = base.clone();
        let filter = other.stages.iter_mut().find(|stage| stage.name == "hsao/filter").unwrap();
        filter.shaders = "other".to_owned();
        assert!(filter.sources.iter().any(|name| name == "shared/bilateral.wgsl"));
        let module = other.sources.get_mut("shared/bilateral.wgsl").unwrap();
        *module =
            module.replacen("const MIN_WEIGHT: f32 = 1e-4;", "const MIN_WEIGHT: f32 = 1e-5;", 1);
        let (differs, diff) = told(&other, "hsao/filter");
        assert_eq!((differs, diff.lines().count()), (Differs::Shader, 11), "{diff}");
        assert!(diff.contains("-const MIN_WEIGHT: f32 = 1e-4;\n+const MIN_WEIGHT: f32 = 1e-5;\n"));
        assert_eq!(first_lines(&"a\n".repeat(50)), "a\n".repeat(40) + "… and 10 lines more\n");
    }

    /// What each stage leaves when the frame ends with it.
    fn left(gpu: &Gpu, subject: &Subject) -> BTreeMap<String, Vec<Vec<f32>>> {
        let pipeline = subject.build(gpu).unwrap();
        let read = |stage: &&Stage| {
            gpu.run(&pipeline.stages_up_to(&[stage.name()])).unwrap();
            let data = stage.dumps.iter().map(|dump| match &dump.data {
                OutputData::Buffer { buffer, .. } => {
                    let bytes = read_buffer(gpu, buffer).unwrap();
                    bytes.into_iter().map(f32::from).collect()
                }
                OutputData::Texture(texture) => read_texture(gpu, texture).unwrap().data,
                OutputData::Volume { texture, level, .. } => {
                    read_volume(gpu, texture, *level).unwrap().data
                }
            });
            (stage.name().to_owned(), data.collect())
        };
        pipeline.stages().iter().map(read).collect()
    }

    /// One parameter at random in each pipeline, a tenth of `FATHOM_DRAWS` times: whatever leaves something else asks for something else.
    #[test]
    fn no_stage_that_leaves_something_else_is_unchanged() {
        let draws: u32 = std::env::var("FATHOM_DRAWS").map_or(1, |text| text.parse().unwrap());
        let draws = draws.div_ceil(10);
        let (gpu, catalog) = (Gpu::open(&Options::default()).unwrap(), Catalog::builtin());
        let mut subjects = Subjects::new(&catalog).silent();
        let mut seen = [0; 2];
        for (kind, scene) in KINDS.iter().zip(SCENES) {
            let mut random = Random::new(77);
            for _ in 0..draws {
                let fields = (kind.fields)();
                let field = &fields[(random.number() * fields.len() as f64) as usize];
                let base = subjects.subject(kind.name, scene, &small(&fields, None)).unwrap();
                let value = parameter::get(&base.params, &field.path).unwrap();
                let drawn = near(value, field.allowed, &mut random);
                let sets = small(&fields, Some((field.path.clone(), drawn)));
                let head = subjects.subject(kind.name, scene, &sets);
                let Some(head) = head.ok().filter(|head| head.build(&gpu).is_ok()) else {
                    continue;
                };
                let [before, after] =
                    [&base, &head].map(|subject| (stages_of(subject), left(&gpu, subject)));
                for (name, holds) in &after.1 {
                    let is_same = before.0.get(name) == after.0.get(name);
                    let is_left = before.1.get(name) == Some(holds);
                    // Sums of atomics may differ from run to run.
                    let is_fault =
                        is_same && !is_left && before.1.get(name) == left(&gpu, &base).get(name);
                    assert!(!is_fault, "{} {}: {name}", kind.name, field.path);
                    seen[usize::from(is_same)] += 1;
                }
            }
        }
        println!("{} stages changed, {} unchanged", seen[0], seen[1]);
        assert!(seen.iter().all(|seen| *seen > 0));
    }

    const SCENES: [&str; 9] =
        ["tank", "ball", "ball", "ball", "smoke", "tank", "ball", "specular", "planar_pool"];

    /// A small picture, with one more parameter.
    fn small(fields: &[ParamField], more: Option<(String, Value)>) -> Vec<(String, Value)> {
        let sizes = [
            ("view.width", json!(24)),
            ("view.height", json!(18)),
            ("shadow.size", json!(32)),
            ("volume.reduce", json!(8)),
            ("caustics.grid", json!(12)),
            ("godrays.grid", json!(8)),
            ("transfer.grid", json!([12, 12])),
        ];
        let sizes = sizes.map(|(path, value)| (path.to_owned(), value)).into_iter();
        sizes
            .filter(|(path, _)| fields.iter().any(|field| field.path == *path))
            .chain(more)
            .collect()
    }

    #[test]
    fn a_warning_of_wgpus_core_voids_a_trace_and_no_other_does() {
        let core = "wgpu_core::device::trace::record";
        assert_eq!(without_warnings(|| log::info!(target: core, "writing")), Ok(()));
        assert_eq!(without_warnings(|| log::warn!(target: "wgpu_hal", "no layer")), Ok(()));
        let warned = without_warnings(|| log::warn!(target: core, "RON serialization failure"));
        assert!(warned.is_err());
        assert_eq!(without_warnings(|| 1), Ok(1));
    }

    #[test]
    fn a_trace_that_is_not_whole_has_no_digest() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path();
        assert!(of_trace(place).unwrap_err().starts_with("no trace"));
        {
            let trace = Some(place.to_owned());
            let gpu = Gpu::open(&Options { trace, ..Options::default() }).unwrap();
            drop(gpu.filled("filled", &[1; 64], wgpu::BufferUsages::COPY_SRC));
            gpu.flush().unwrap();
        }
        assert_eq!(of_trace(place).unwrap().stages, BTreeMap::new());
        let uploads = std::fs::read_dir(place).unwrap().map(|entry| entry.unwrap().path());
        let uploads = uploads.filter(|path| path.extension().is_some_and(|ext| ext == "bin"));
        let [upload] = uploads.collect::<Vec<_>>().try_into().unwrap();
        std::fs::write(&upload, [1; 60]).unwrap();
        assert!(of_trace(place).unwrap_err().ends_with("is cut short"));
        std::fs::remove_file(&upload).unwrap();
        assert!(of_trace(place).is_err());
        std::fs::write(&upload, [1; 64]).unwrap();
        assert!(of_trace(place).is_ok());
        let text = std::fs::read_to_string(place.join("trace.ron")).unwrap();
        for end in [text.len() - 1, text.len() / 2, 1] {
            std::fs::write(place.join("trace.ron"), &text[..end]).unwrap();
            assert_eq!(of_trace(place), Err("the trace does not end".to_owned()), "{end}");
        }
        // Room again after some of an action could not be written.
        let cut = text.find("WriteBuffer(").unwrap() + 20;
        std::fs::write(place.join("trace.ron"), text[..cut].to_owned() + "\n]").unwrap();
        assert_eq!(of_trace(place), Err("an action of the trace is cut short".to_owned()));
    }
}
