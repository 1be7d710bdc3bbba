//! A PLY file of fixed-size records: its header by `ply-rs-bw`, then record by record without holding the file.
//!
//! The crate's own payload reader makes a map of values of every record, which is slow and heavy for millions of Gaussians.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, PropertyType, ScalarType};

use crate::data::DataError;

/// Longest header that is looked at, bytes; one of Gaussians has two thousand.
const MAX_HEADER: u64 = 1 << 16;
/// Longest line of an ASCII record, bytes.
const MAX_LINE: u64 = 1 << 16;
/// Read at once, bytes.
const BUFFER: usize = 1 << 20;

/// A PLY file by its header.
#[derive(Debug)]
pub(super) struct PlyFile {
    path: PathBuf,
    is_ascii: bool,
    /// The header's comments, in order.
    pub(super) comments: Vec<String>,
    elements: Vec<Element>,
    n_bytes: u64,
}

/// Records of one kind.
#[derive(Debug)]
pub(super) struct Element {
    name: String,
    /// Number of records.
    pub(super) n: usize,
    /// In file order.
    fields: Vec<(String, Field)>,
    /// Length of a record, bytes.
    n_bytes: usize,
    /// Where the first record starts, in bytes and then lines (ASCII); `None` with or after lists, whose length varies.
    start: Option<(u64, usize)>,
}

/// Where a number lies in a record.
#[derive(Clone, Debug)]
pub(super) struct Field {
    /// Bytes from the record's start.
    offset: usize,
    kind: ScalarType,
    is_big_endian: bool,
}

impl PlyFile {
    /// Reads the header.
    pub(super) fn open(path: &Path) -> Result<Self, DataError> {
        let io = |e| DataError::io(path, e);
        let file = File::open(path).map_err(io)?;
        let n_bytes = file.metadata().map_err(io)?.len();
        let mut head = Vec::new();
        file.take(MAX_HEADER).read_to_end(&mut head).map_err(io)?;
        // Comments may be in any encoding, and the parser wants UTF-8.
        for byte in head.iter_mut().filter(|byte| !byte.is_ascii()) {
            *byte = b'?';
        }
        let mut reader = Reader::new(&head[..]);
        let header = Parser::<DefaultElement>::new()
            .read_header(&mut reader)
            .map_err(|e| DataError::unusable(path, format!("not a readable PLY header: {e}")))?;
        let header_bytes = (head.len() - reader.get_ref().len()) as u64;
        let mut start = Some((header_bytes, 0));
        let mut elements = Vec::new();
        for (_, element) in &header.elements {
            let element = Element::new(element, header.encoding, start);
            start = element.end(header.encoding);
            elements.push(element);
        }
        Ok(Self {
            path: path.to_owned(),
            is_ascii: header.encoding == Encoding::Ascii,
            comments: header.comments,
            elements,
            n_bytes,
        })
    }

    /// The records of a name.
    pub(super) fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }

    /// Its records one after the other.
    ///
    /// # Errors
    /// When the file is too short for them, or lists make it unclear where they are.
    pub(super) fn rows(&self, element: &Element) -> Result<Rows, DataError> {
        let Element { name, n, .. } = element;
        let Some((start, n_lines)) = element.start else {
            let problem = format!("element {name}: lists in or before it");
            return Err(DataError::unusable(&self.path, problem));
        };
        // A number of a line takes two bytes at least.
        let least = if self.is_ascii {
            element.fields.len() * 2
        } else {
            element.n_bytes
        };
        let end = (least as u64).checked_mul(*n as u64);
        let end = end.and_then(|n_bytes| n_bytes.checked_add(start));
        // The last line may end with the file.
        if end.is_none_or(|end| end > self.n_bytes + u64::from(self.is_ascii)) {
            let n_bytes = self.n_bytes;
            let problem = format!("element {name}: {n} records do not fit into {n_bytes} bytes");
            return Err(DataError::unusable(&self.path, problem));
        }
        let io = |e| DataError::io(&self.path, e);
        let mut file = File::open(&self.path).map_err(io)?;
        file.seek(SeekFrom::Start(start)).map_err(io)?;
        let mut rows = Rows {
            path: self.path.clone(),
            element: name.clone(),
            reader: BufReader::with_capacity(BUFFER, file),
            row: vec![0; element.n_bytes],
            line: self.is_ascii.then(String::new),
        };
        for _ in 0..n_lines {
            rows.next_line()?;
        }
        Ok(rows)
    }
}

impl Element {
    fn new(element: &ElementDef, encoding: Encoding, start: Option<(u64, usize)>) -> Self {
        let mut fields = Vec::new();
        let mut n_bytes = 0;
        let mut has_lists = false;
        for (name, property) in &element.properties {
            // Numbers of a line are turned into these.
            let kind = match &property.data_type {
                _ if encoding == Encoding::Ascii => ScalarType::Float,
                PropertyType::Scalar(kind) => kind.clone(),
                PropertyType::List(..) => ScalarType::Char,
            };
            has_lists |= matches!(property.data_type, PropertyType::List(..));
            let is_big_endian = encoding == Encoding::BinaryBigEndian;
            let field = Field {
                offset: n_bytes,
                kind,
                is_big_endian,
            };
            n_bytes += field.n_bytes();
            fields.push((name.clone(), field));
        }
        Self {
            name: element.name.clone(),
            n: element.count,
            fields,
            n_bytes,
            start: start.filter(|_| !has_lists),
        }
    }

    /// Where the records after it start.
    fn end(&self, encoding: Encoding) -> Option<(u64, usize)> {
        let (bytes, lines) = self.start?;
        if encoding == Encoding::Ascii {
            return Some((bytes, lines.checked_add(self.n)?));
        }
        let n_bytes = (self.n_bytes as u64).checked_mul(self.n as u64)?;
        Some((bytes.checked_add(n_bytes)?, 0))
    }

    /// The field of a name.
    pub(super) fn field(&self, name: &str) -> Option<Field> {
        let found = self.fields.iter().find(|(other, _)| other == name);
        found.map(|(_, field)| field.clone())
    }

    /// The fields of these names; an error that names the first one that is missing.
    pub(super) fn fields<const N: usize>(
        &self,
        path: &Path,
        names: [&str; N],
    ) -> Result<[Field; N], DataError> {
        if let Some(missing) = names.iter().find(|name| self.field(name).is_none()) {
            let problem = format!("element {}: no property {missing}", self.name);
            return Err(DataError::unusable(path, problem));
        }
        Ok(names.map(|name| self.field(name).expect("each was found")))
    }

    /// The fields `{prefix}0`, `{prefix}1` and so on.
    pub(super) fn series(&self, prefix: &str) -> Vec<Field> {
        let field = |i| self.field(&format!("{prefix}{i}"));
        (0..).map_while(field).collect()
    }
}

impl Field {
    const fn n_bytes(&self) -> usize {
        match self.kind {
            ScalarType::Char | ScalarType::UChar => 1,
            ScalarType::Short | ScalarType::UShort => 2,
            ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
            ScalarType::Double => 8,
        }
    }

    /// Its number in a record.
    #[inline]
    pub(super) fn number(&self, row: &[u8]) -> f32 {
        match self.kind {
            ScalarType::Float => f32::from_le_bytes(self.bytes(row)),
            ScalarType::Double => f64::from_le_bytes(self.bytes(row)) as f32,
            ScalarType::Char => f32::from(i8::from_le_bytes(self.bytes(row))),
            ScalarType::UChar => f32::from(u8::from_le_bytes(self.bytes(row))),
            ScalarType::Short => f32::from(i16::from_le_bytes(self.bytes(row))),
            ScalarType::UShort => f32::from(u16::from_le_bytes(self.bytes(row))),
            ScalarType::Int => i32::from_le_bytes(self.bytes(row)) as f32,
            ScalarType::UInt => u32::from_le_bytes(self.bytes(row)) as f32,
        }
    }

    /// Its bits in a record, of an integer of 32.
    pub(super) fn bits(&self, row: &[u8]) -> Option<u32> {
        matches!(self.kind, ScalarType::Int | ScalarType::UInt)
            .then(|| u32::from_le_bytes(self.bytes(row)))
    }

    /// Little-endian.
    #[inline]
    fn bytes<const N: usize>(&self, row: &[u8]) -> [u8; N] {
        let bytes = row[self.offset..].first_chunk();
        let mut bytes = *bytes.expect("a record holds its fields");
        if self.is_big_endian {
            bytes.reverse();
        }
        bytes
    }
}

/// Records one after the other.
#[derive(Debug)]
pub(super) struct Rows {
    path: PathBuf,
    element: String,
    reader: BufReader<File>,
    row: Vec<u8>,
    /// The last line of an ASCII file.
    line: Option<String>,
}

impl Rows {
    /// The next record's bytes.
    pub(super) fn next(&mut self) -> Result<&[u8], DataError> {
        if self.line.is_some() {
            self.next_line()?;
            self.parse_line()?;
        } else if let Err(e) = self.reader.read_exact(&mut self.row) {
            return Err(self.broken(&e));
        }
        Ok(&self.row)
    }

    fn next_line(&mut self) -> Result<(), DataError> {
        let line = self.line.as_mut().expect("only ASCII files have lines");
        line.clear();
        match (&mut self.reader).take(MAX_LINE).read_line(line) {
            Ok(0) => Err(self.broken("the file ends")),
            Ok(_) => Ok(()),
            Err(e) => Err(self.broken(e)),
        }
    }

    /// Turns the numbers of a line into a record of `f32`.
    fn parse_line(&mut self) -> Result<(), DataError> {
        let line = self.line.as_deref().unwrap_or_default();
        let mut numbers = line.split_ascii_whitespace();
        for bytes in self.row.as_chunks_mut::<4>().0 {
            let number: Option<f32> = numbers.next().and_then(|number| number.parse().ok());
            let Some(number) = number else {
                let problem = format!("no numbers: {}", line.trim_ascii());
                return Err(self.broken(problem.chars().take(80).collect::<String>()));
            };
            *bytes = number.to_le_bytes();
        }
        Ok(())
    }

    fn broken(&self, problem: impl std::fmt::Display) -> DataError {
        let problem = format!("element {}: {problem}", self.element);
        DataError::unusable(&self.path, problem)
    }
}
