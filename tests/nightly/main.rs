//! What needs more than lavapipe, git, python3 and valgrind: Chromium, Vulkan's validation layer, compilers of C and C++, the tools of jobs.
//! `make test-all` installs these and runs it. Where one is missing, its test fails.
#![cfg(target_os = "linux")]

mod card;
mod claims;
#[path = "../common/mod.rs"]
mod common;
mod faults;
mod jobs;
mod machine;
mod page;
#[allow(dead_code)]
#[path = "../compare/stored.rs"]
mod stored;
mod tint;
mod validation;
mod vello_frames;
mod vulkan_worker;

use common::{gpu, this_program};
