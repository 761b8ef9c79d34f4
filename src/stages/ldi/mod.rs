pub mod peel;
