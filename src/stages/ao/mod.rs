//! Volume ambient occlusion. VAO §5.1, §6.
