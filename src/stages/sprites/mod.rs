pub mod compose;
pub mod draw;
