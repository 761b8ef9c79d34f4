pub mod compose;
pub mod points;
