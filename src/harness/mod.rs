pub mod sample;
pub mod verify;
