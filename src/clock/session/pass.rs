//! A pass that ends its timing when it is dropped.

use std::ops::{Deref, DerefMut};

use crate::{Device, FrameTimer};

/// An open pass. It ends, and its timing with it, when this is dropped.
pub struct TimedPass<'f, P> {
    /// Taken when it ends.
    pass: Option<P>,
    /// None in a frame without per-pass timing.
    timer: Option<(&'f mut FrameTimer, &'f Device)>,
    encoder: &'f mut wgpu::CommandEncoder,
}

impl<'f, P> TimedPass<'f, P> {
    pub(super) fn new(
        pass: P,
        timer: Option<(&'f mut FrameTimer, &'f Device)>,
        encoder: &'f mut wgpu::CommandEncoder,
    ) -> Self {
        Self { pass: Some(pass), timer, encoder }
    }
}

impl<P> Deref for TimedPass<'_, P> {
    type Target = P;

    fn deref(&self) -> &P {
        self.pass.as_ref().expect("the pass ends with this")
    }
}

impl<P> DerefMut for TimedPass<'_, P> {
    fn deref_mut(&mut self) -> &mut P {
        self.pass.as_mut().expect("the pass ends with this")
    }
}

impl<P> Drop for TimedPass<'_, P> {
    fn drop(&mut self) {
        // The encoder can be ended only when it has no open pass.
        self.pass = None;
        if let Some((timer, gpu)) = &mut self.timer {
            timer.close(gpu, self.encoder);
        }
    }
}
