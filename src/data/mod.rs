//! data
pub mod tensor_file;
