//! Voxelization. VAO §4.
