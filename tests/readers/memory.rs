//! Counts the memory that each thread holds, so that a test can say how much a reader took.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static HELD: Cell<usize> = const { Cell::new(0) };
    static PEAK: Cell<usize> = const { Cell::new(0) };
    static EVER: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counted. Blocks that grow are a new block, as the default of [`GlobalAlloc::realloc`] has it.
pub struct Counting;

// SAFETY: every call goes to the system's allocator as it came; counting touches no memory of the caller's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // A thread that ends has no counter any more.
        let _ = EVER.try_with(|ever| ever.set(ever.get() + layout.size()));
        let _ = HELD.try_with(|held| {
            held.set(held.get().saturating_add(layout.size()));
            let _ = PEAK.try_with(|peak| peak.set(peak.get().max(held.get())));
        });
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // What another thread took counts as nothing here.
        let _ = HELD.try_with(|held| held.set(held.get().saturating_sub(layout.size())));
        unsafe { System.dealloc(place, layout) }
    }
}

/// What `work` gives, the most bytes that this thread held in it beyond those of before, and how many it took in all.
pub fn counted<T>(work: impl FnOnce() -> T) -> (T, usize, usize) {
    let (held, ever) = (HELD.get(), EVER.get());
    PEAK.set(held);
    let result = work();
    (result, PEAK.get() - held, EVER.get() - ever)
}

#[test]
fn what_is_taken_and_given_back_is_counted() {
    let (_, peak, ever) = counted(|| (0..4).for_each(|_| drop(vec![1u8; 1 << 20])));
    assert_eq!((peak >> 20, ever >> 20), (1, 4));
}
