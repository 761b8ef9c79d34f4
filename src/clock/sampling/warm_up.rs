//! Frames before the first that counts.

/// Warm-up is over once a frame is not faster than the one before it by more than this share.
pub const WARM_UP_TOLERANCE: f64 = 0.1;
/// Frames after which warm-up is given up, and said so.
pub const MAX_WARM_UP_FRAMES: u32 = 10;

/// Renders frames of both kinds in turn until they no longer get faster: the first ones hold the driver's compilation of shaders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarmUp {
    pub frames: u32,
    before_ns: f64,
    known_ns: f64,
    /// The frame time no longer fell.
    pub steady: bool,
}

impl Default for WarmUp {
    fn default() -> Self {
        Self { frames: 0, before_ns: f64::INFINITY, known_ns: 0.0, steady: false }
    }
}

impl WarmUp {
    /// Of a program whose frames took so long before, where that is known: one that takes no longer is enough.
    pub fn after(known_ns: Option<f64>) -> Self {
        Self { known_ns: known_ns.unwrap_or(0.0), ..Self::default() }
    }

    /// The next frame is one with per-stage timing.
    pub fn is_timed(&self) -> bool {
        self.frames.is_multiple_of(2)
    }

    /// A frame took so long.
    pub fn add(&mut self, wall_ns: f64) {
        self.frames += 1;
        self.steady = wall_ns <= self.known_ns * (1.0 + WARM_UP_TOLERANCE)
            || self.frames > 1 && wall_ns >= self.before_ns * (1.0 - WARM_UP_TOLERANCE);
        self.before_ns = wall_ns;
    }

    pub fn is_over(&self) -> bool {
        self.steady || self.frames >= MAX_WARM_UP_FRAMES
    }
}
