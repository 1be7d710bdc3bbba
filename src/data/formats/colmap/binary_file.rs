//! A little-endian file read field by field, with errors that say which field it broke off at.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;

use crate::data::DataError;

/// The longest name accepted, bytes; no file system takes longer ones.
const MAX_NAME: u64 = 4096;

/// An open file, how much of it is left, and which record is being read.
pub(super) struct BinaryFile<'a> {
    path: &'a Path,
    reader: BufReader<File>,
    n_left: u64,
    record: Option<usize>,
}

impl<'a> BinaryFile<'a> {
    pub(super) fn open(path: &'a Path) -> Result<Self, DataError> {
        let io = |e| DataError::io(path, e);
        let file = File::open(path).map_err(io)?;
        let n_left = file.metadata().map_err(io)?.len();
        Ok(Self {
            path,
            reader: BufReader::new(file),
            n_left,
            record: None,
        })
    }

    /// Says for messages which record follows.
    pub(super) fn begin_record(&mut self, index: usize) {
        self.record = Some(index);
    }

    pub(super) fn error(&self, field: &str, problem: impl Into<String>) -> DataError {
        DataError::field(self.path, field, problem).in_frame(self.record)
    }

    fn take(&mut self, field: &str, n_bytes: u64) -> Result<(), DataError> {
        match self.n_left.checked_sub(n_bytes) {
            Some(rest) => {
                self.n_left = rest;
                Ok(())
            }
            None => Err(self.error(field, "the file ends here")),
        }
    }

    fn bytes<const N: usize>(&mut self, field: &str) -> Result<[u8; N], DataError> {
        self.take(field, N as u64)?;
        let mut bytes = [0; N];
        self.reader
            .read_exact(&mut bytes)
            .map_err(|e| DataError::io(self.path, e))?;
        Ok(bytes)
    }

    pub(super) fn u8(&mut self, field: &str) -> Result<u8, DataError> {
        self.bytes::<1>(field).map(|[byte]| byte)
    }

    pub(super) fn u32(&mut self, field: &str) -> Result<u32, DataError> {
        self.bytes(field).map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self, field: &str) -> Result<u64, DataError> {
        self.bytes(field).map(u64::from_le_bytes)
    }

    /// A number that may be infinite or none.
    pub(super) fn any_f64(&mut self, field: &str) -> Result<f64, DataError> {
        self.bytes(field).map(f64::from_le_bytes)
    }

    /// A number, which must be finite.
    pub(super) fn f64(&mut self, field: &str) -> Result<f64, DataError> {
        let value = self.any_f64(field)?;
        if value.is_finite() {
            Ok(value)
        } else {
            Err(self.error(field, format!("{value} is not a finite number")))
        }
    }

    pub(super) fn f64s<const N: usize>(&mut self, field: &str) -> Result<[f64; N], DataError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64(field)?;
        }
        Ok(values)
    }

    /// A number of records that take at least `record_bytes` each; more than the rest of the file
    /// can hold is an error, so that nothing is allocated for it.
    pub(super) fn count(&mut self, field: &str, record_bytes: u64) -> Result<usize, DataError> {
        let count = self.u64(field)?;
        let room = self.n_left / record_bytes;
        if count > room {
            let problem = format!("{count} are announced, but the file has room for {room}");
            return Err(self.error(field, problem));
        }
        Ok(count as usize)
    }

    /// A text that ends with a zero byte.
    pub(super) fn name(&mut self, field: &str) -> Result<String, DataError> {
        let mut bytes = Vec::new();
        let limit = MAX_NAME.min(self.n_left);
        (&mut self.reader)
            .take(limit)
            .read_until(0, &mut bytes)
            .map_err(|e| DataError::io(self.path, e))?;
        self.take(field, bytes.len() as u64)?;
        if bytes.pop() != Some(0) {
            return Err(self.error(field, "the text does not end"));
        }
        String::from_utf8(bytes).map_err(|_not_utf8| {
            self.error(field, "not UTF-8; rename the photo and register again")
        })
    }

    /// Passes over `n` records of `record_bytes`, whose room [`Self::count`] has checked.
    pub(super) fn skip(
        &mut self,
        field: &str,
        n: usize,
        record_bytes: u64,
    ) -> Result<(), DataError> {
        let n_bytes = n as u64 * record_bytes;
        self.take(field, n_bytes)?;
        self.reader
            .seek_relative(n_bytes as i64)
            .map_err(|e| DataError::io(self.path, e))
    }
}
