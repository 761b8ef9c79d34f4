//! What a frame is made of.

use super::StageScope;

/// A unit of a frame that is timed.
pub trait TimedStage {
    /// The name under which the time is recorded.
    fn name(&self) -> &'static str;
    /// Opens the stage's passes. Called once per frame, or once for each of its [`turns`](Self::turns).
    fn encode(&self, scope: &mut StageScope<'_>);
    /// How often the stage is encoded in a frame. Neighbours with the same number of turns, more than one, take them together.
    fn turns(&self) -> u32 {
        1
    }
}
