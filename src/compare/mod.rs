//! Two builds held against each other, stage by stage.
//!
//! [`worker`] is the measured side: a process that holds the prepared configurations of one build and answers
//! [`protocol`]'s requests.

pub mod protocol;
pub mod worker;
