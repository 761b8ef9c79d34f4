pub mod lists;
pub mod peel;
pub mod sort;
