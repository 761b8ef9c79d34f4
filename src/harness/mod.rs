pub mod landing;
pub mod sample;
pub mod verify;
