//! Ambient occlusion in scalar fields. VAO §5.2.
