//! Python pickles of numpy arrays in tuples, lists and dictionaries, read without running anything.
//!
//! A pickle is a program for a small stack machine (`Lib/pickletools.py`). Only what builds plain values is known here, in
//! protocols 1 to 5 (numpy's arrays are binary); the
//! names of functions are looked up in a list of four that numpy writes, and anything else is an error. What a file makes is
//! no larger than its bytes allow: values are shared, never copied.

use super::npy::{Array, Kind};

/// Bytes of the largest pickle read; a camera has 500.
pub(in crate::data) const MAX_BYTES: u64 = 1 << 20;
/// Values looked at in the result: a list may hold itself, or one list a thousand times over.
const MAX_VISITS: usize = 1000;
/// Dimensions of an array.
const MAX_DIMENSIONS: usize = 8;

/// A value on the machine's stack: a place in its memory.
type Place = usize;

/// A value that a pickle describes.
#[derive(Clone, Debug)]
enum Value {
    None,
    Int(i64),
    Bytes(Vec<u8>),
    Text(String),
    /// A tuple, list or dictionary (keys and values in turn).
    Items(Vec<Place>),
    /// A function by its module and name.
    Name(String),
    /// An array whose numbers are yet to come.
    Blank,
    Kind(Kind),
    Array(Array),
}

/// The arrays in a pickle, in the order in which they lie in its tuples, lists and dictionaries; or what is wrong with it.
pub(in crate::data) fn arrays(bytes: &[u8]) -> Result<Vec<Array>, String> {
    let mut machine = Machine {
        rest: bytes,
        values: Vec::new(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: Vec::new(),
    };
    let top = machine.run()?;
    let (mut found, mut n_left) = (Vec::new(), MAX_VISITS);
    machine.collect(top, &mut n_left, &mut found)?;
    Ok(found)
}

struct Machine<'a> {
    rest: &'a [u8],
    values: Vec<Value>,
    stack: Vec<Place>,
    /// Heights of the stack.
    marks: Vec<usize>,
    memo: Vec<(usize, Place)>,
}

fn cut() -> String {
    "the file ends early".to_owned()
}

impl Machine<'_> {
    fn take(&mut self, n: usize) -> Result<&[u8], String> {
        let (head, tail) = self.rest.split_at_checked(n).ok_or_else(cut)?;
        self.rest = tail;
        Ok(head)
    }

    /// A number of `n` bytes, the lowest first.
    fn number(&mut self, n: usize) -> Result<usize, String> {
        let bytes = self.take(n)?;
        let number = bytes
            .iter()
            .rev()
            .fold(0_u64, |sum, b| sum << 8 | u64::from(*b));
        usize::try_from(number).map_err(|_too_large| cut())
    }

    fn line(&mut self) -> Result<String, String> {
        let end = self.rest.iter().position(|b| *b == b'\n').ok_or_else(cut)?;
        let text = String::from_utf8_lossy(&self.rest[..end]).into_owned();
        self.rest = &self.rest[end + 1..];
        Ok(text)
    }

    fn push_text(&mut self, n_length: usize) -> Result<(), String> {
        let n = self.number(n_length)?;
        let text = String::from_utf8(self.take(n)?.to_vec());
        self.push(Value::Text(
            text.map_err(|_not_utf8| "a text is not UTF-8")?,
        ));
        Ok(())
    }

    fn push_bytes(&mut self, n_length: usize) -> Result<(), String> {
        let n = self.number(n_length)?;
        let bytes = self.take(n)?.to_vec();
        self.push(Value::Bytes(bytes));
        Ok(())
    }

    fn push(&mut self, value: Value) {
        self.stack.push(self.values.len());
        self.values.push(value);
    }

    fn pop(&mut self) -> Result<Place, String> {
        let floor = self.marks.last().copied().unwrap_or(0);
        let top = self.stack.pop().filter(|_| self.stack.len() >= floor);
        top.ok_or_else(|| "it takes values that are not there".to_owned())
    }

    /// What lies above the last mark.
    fn pop_marked(&mut self) -> Result<Vec<Place>, String> {
        let mark = self
            .marks
            .pop()
            .ok_or("it takes a mark that is not there")?;
        Ok(self.stack.split_off(mark.min(self.stack.len())))
    }

    /// Appends to the list or dictionary on top.
    fn append(&mut self, items: Vec<Place>) -> Result<(), String> {
        let top = *self.stack.last().ok_or("it appends to nothing")?;
        match &mut self.values[top] {
            Value::Items(list) => list.extend(items),
            _ => return Err("it appends to what is no list".to_owned()),
        }
        Ok(())
    }

    fn remember(&mut self, key: usize) -> Result<(), String> {
        let top = *self.stack.last().ok_or("it remembers nothing")?;
        self.memo.push((key, top));
        Ok(())
    }

    fn recall(&mut self, key: usize) -> Result<(), String> {
        let found = self.memo.iter().rev().find(|(k, _)| *k == key);
        let (_, place) = found.ok_or("it recalls what it never remembered")?;
        self.stack.push(*place);
        Ok(())
    }

    /// Runs to the end; the place of the result.
    fn run(&mut self) -> Result<Place, String> {
        loop {
            let code = self.take(1)?[0];
            match code {
                b'.' => return self.pop(),
                // PROTO, FRAME
                0x80 => drop(self.take(1)?),
                0x95 => drop(self.take(8)?),
                b'(' => self.marks.push(self.stack.len()),
                b'0' => drop(self.pop()?),
                b'1' => drop(self.pop_marked()?),
                b'2' => {
                    let top = *self.stack.last().ok_or("it doubles nothing")?;
                    self.stack.push(top);
                }
                b'N' => self.push(Value::None),
                0x88 | 0x89 => self.push(Value::Int(i64::from(code == 0x88))),
                b'K' | b'M' | b'J' | b'I' | b'L' | b'G' | 0x8a => self.push_number(code)?,
                b'U' | b'C' => self.push_bytes(1)?,
                b'T' | b'B' => self.push_bytes(4)?,
                0x8e | 0x96 => self.push_bytes(8)?,
                0x8c => self.push_text(1)?,
                b'X' => self.push_text(4)?,
                0x8d => self.push_text(8)?,
                b')' | b']' | b'}' => self.push(Value::Items(Vec::new())),
                b't' | b'l' | b'd' => {
                    let items = self.pop_marked()?;
                    self.push(Value::Items(items));
                }
                0x85..=0x87 => self.push_tuple(usize::from(code - 0x84))?,
                b'a' => {
                    let item = self.pop()?;
                    self.append(vec![item])?;
                }
                b's' => {
                    let value = self.pop()?;
                    let key = self.pop()?;
                    self.append(vec![key, value])?;
                }
                b'e' | b'u' => {
                    let items = self.pop_marked()?;
                    self.append(items)?;
                }
                b'q' | b'r' => {
                    let key = self.number(if code == b'q' { 1 } else { 4 })?;
                    self.remember(key)?;
                }
                b'h' | b'j' => {
                    let key = self.number(if code == b'h' { 1 } else { 4 })?;
                    self.recall(key)?;
                }
                // MEMOIZE
                0x94 => self.remember(self.memo.len())?,
                b'c' => {
                    let (module, name) = (self.line()?, self.line()?);
                    self.push(Value::Name(format!("{module}.{name}")));
                }
                0x93 => self.push_name()?,
                b'R' => self.call()?,
                b'b' => self.build()?,
                _ => return Err(format!("operation 0x{code:02x} is none of plain arrays")),
            }
        }
    }

    fn push_number(&mut self, code: u8) -> Result<(), String> {
        let value = match code {
            b'K' => Value::Int(self.number(1)? as i64),
            b'M' => Value::Int(self.number(2)? as i64),
            b'J' => Value::Int(i64::from(self.number(4)? as u32 as i32)),
            0x8a => {
                let n = self.number(1)?;
                if n > 8 {
                    return Err("a whole number of more than 64 bits".to_owned());
                }
                Value::Int(self.number(n)? as i64)
            }
            // Numbers in no array say nothing about cameras.
            b'G' => {
                self.take(8)?;
                Value::None
            }
            _ => {
                let line = self.line()?;
                let digits = line.trim_end_matches('L');
                let number = digits.parse().map_err(|_no_number| "a number is none")?;
                Value::Int(number)
            }
        };
        self.push(value);
        Ok(())
    }

    fn push_tuple(&mut self, n: usize) -> Result<(), String> {
        let mut items = (0..n).map(|_| self.pop()).collect::<Result<Vec<_>, _>>()?;
        items.reverse();
        self.push(Value::Items(items));
        Ok(())
    }

    fn push_name(&mut self) -> Result<(), String> {
        let (name, module) = (self.pop()?, self.pop()?);
        let (Value::Text(module), Value::Text(name)) = (&self.values[module], &self.values[name])
        else {
            return Err("the name of a function is no text".to_owned());
        };
        let name = format!("{module}.{name}");
        self.push(Value::Name(name));
        Ok(())
    }

    /// What one of the known functions makes of its arguments.
    fn call(&mut self) -> Result<(), String> {
        let (arguments, function) = (self.pop()?, self.pop()?);
        let Value::Name(name) = &self.values[function] else {
            return Err("it calls what is no function".to_owned());
        };
        let arguments: Vec<&Value> = match &self.values[arguments] {
            Value::Items(items) => items.iter().map(|place| &self.values[*place]).collect(),
            _ => return Err(format!("{name} is called without arguments")),
        };
        // numpy 2 has moved them.
        let name = name.replace("numpy._core.", "numpy.core.");
        let value = match (name.as_str(), arguments.as_slice()) {
            ("numpy.core.multiarray._reconstruct", _) => Value::Blank,
            ("numpy.dtype", [Value::Text(kind), ..]) => Value::Kind(Kind::of(kind)?),
            ("numpy.dtype", [Value::Bytes(kind), ..]) => {
                Value::Kind(Kind::of(&String::from_utf8_lossy(kind))?)
            }
            // Bytes in older protocols, as a text of their codes.
            ("_codecs.encode", [Value::Text(text), ..]) => {
                let bytes = text.chars().map(|c| u8::try_from(u32::from(c)));
                let bytes: Result<Vec<u8>, _> = bytes.collect();
                Value::Bytes(bytes.map_err(|_not_latin1| "bytes are no bytes")?)
            }
            (
                "numpy.core.numeric._frombuffer",
                [Value::Bytes(bytes), Value::Kind(kind), shape, order],
            ) => {
                let is_fortran = matches!(order, Value::Text(order) if order == "F");
                Value::Array(kind.array(&self.shape(shape)?, is_fortran, bytes)?)
            }
            _ => {
                return Err(format!(
                    "it calls {name}, and functions in pickles are not run"
                ));
            }
        };
        self.push(value);
        Ok(())
    }

    fn shape(&self, value: &Value) -> Result<Vec<usize>, String> {
        let fail = || "the shape of an array is none".to_owned();
        let Value::Items(sides) = value else {
            return Err(fail());
        };
        if sides.len() > MAX_DIMENSIONS {
            return Err(fail());
        }
        let side = |place: &Place| match self.values[*place] {
            Value::Int(side) => usize::try_from(side).map_err(|_negative| fail()),
            _ => Err(fail()),
        };
        sides.iter().map(side).collect()
    }

    /// Gives an array its numbers, or a kind of number its order of bytes.
    fn build(&mut self) -> Result<(), String> {
        let state = self.pop()?;
        let target = *self.stack.last().ok_or("it builds nothing")?;
        let Value::Items(state) = &self.values[state] else {
            return Err("the state of an object is no tuple".to_owned());
        };
        let state: Vec<&Value> = state.iter().map(|place| &self.values[*place]).collect();
        let built = match (&self.values[target], state.as_slice()) {
            (Value::Blank, [_, shape, Value::Kind(kind), order, Value::Bytes(bytes)]) => {
                let is_fortran = matches!(order, Value::Int(1));
                Value::Array(kind.array(&self.shape(shape)?, is_fortran, bytes)?)
            }
            (Value::Kind(kind), [_, Value::Text(order), ..]) => {
                Value::Kind(kind.in_order(order.as_bytes()))
            }
            (Value::Kind(kind), [_, Value::Bytes(order), ..]) => Value::Kind(kind.in_order(order)),
            _ => return Err("the state of an array is none that is known".to_owned()),
        };
        self.values[target] = built;
        Ok(())
    }

    /// Adds the arrays of a value; `n_left`: values that may still be looked at.
    fn collect(
        &self,
        place: Place,
        n_left: &mut usize,
        found: &mut Vec<Array>,
    ) -> Result<(), String> {
        *n_left = n_left
            .checked_sub(1)
            .ok_or("lists within lists without end")?;
        match &self.values[place] {
            Value::Array(array) => found.push(array.clone()),
            Value::Items(items) => {
                for item in items {
                    self.collect(*item, n_left, found)?;
                }
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
pub(in crate::data) mod tests {
    use super::*;

    // What Python 3 with numpy 2 writes for a tuple of `POSE` as float32 and `LENS` as float64, in three protocols.
    const PROTOCOL_2: &str = "8002636e756d70792e5f636f72652e6d756c746961727261790a5f7265636f6e7374727563740a7100636e756d70790a6e646172 \
     7261790a71014b00857102635f636f646563730a656e636f64650a7103580100000062710458060000006c6174696e3171058671 \
     06527107877108527109284b014b034b0486710a636e756d70790a64747970650a710b58020000006634710c898887710d52710e \
     284b0358010000003c710f4e4e4e4affffffff4affffffff4b007471106289680358370000000000c2803f000000000000000000 \
     00c2803e000000000000c280c2bf00000000000000c2bf00000000000000000000c280c2bf000000407111680586711252711374 \
     711462680068014b008571156807877116527117284b014b034b03867118680b580200000066387119898887711a52711b284b03 \
     680f4e4e4e4affffffff4affffffff4b0074711c62896803584a0000000000000000407f40000000000000000000000000000079 \
     4000000000000000000000000000407f400000000000c380724000000000000000000000000000000000000000000000c3b03f71 \
     1d680586711e52711f747120628671212e";
    pub(in crate::data) const PROTOCOL_4: &str = "80049547010000000000008c166e756d70792e5f636f72652e6d756c74696172726179948c0c5f7265636f6e7374727563749493 \
     948c056e756d7079948c076e6461727261799493944b0085944301629487945294284b014b034b04869468038c05647479706594 \
     93948c02663494898887945294284b038c013c944e4e4e4affffffff4affffffff4b007494628943300000803f00000000000000 \
     000000803e00000000000080bf00000000000000bf0000000000000000000080bf0000004094749462680268054b008594680787 \
     945294284b014b034b038694680c8c02663894898887945294284b0368104e4e4e4affffffff4affffffff4b0074946289434800 \
     00000000407f400000000000000000000000000000794000000000000000000000000000407f400000000000c072400000000000 \
     0000000000000000000000000000000000f03f9474946286942e";
    const PROTOCOL_5: &str = "8005952d010000000000008c136e756d70792e5f636f72652e6e756d65726963948c0b5f66726f6d627566666572949394289630 \
     000000000000000000803f00000000000000000000803e00000000000080bf00000000000000bf0000000000000000000080bf00 \
     000040948c056e756d7079948c0564747970659493948c02663494898887945294284b038c013c944e4e4e4affffffff4affffff \
     ff4b007494624b034b0486948c014394749452946802289648000000000000000000000000407f40000000000000000000000000 \
     0000794000000000000000000000000000407f400000000000c0724000000000000000000000000000000000000000000000f03f \
     9468068c02663894898887945294284b03680a4e4e4e4affffffff4affffffff4b007494624b034b038694680d7494529486942e";
    // A list, the pose with its first index running fastest.
    const FORTRAN: &str = "80049549010000000000005d94288c166e756d70792e5f636f72652e6d756c74696172726179948c0c5f7265636f6e7374727563 \
     749493948c056e756d7079948c076e6461727261799493944b0085944301629487945294284b014b034b04869468048c05647479 \
     70659493948c02663494898887945294284b038c013c944e4e4e4affffffff4affffffff4b007494628843300000803f00000000 \
     0000000000000000000080bf000000000000000000000000000080bf0000803e000000bf0000004094749462680368064b008594 \
     680887945294284b014b034b038694680d8c02663894898887945294284b0368114e4e4e4affffffff4affffffff4b0074946289 \
     43480000000000407f400000000000000000000000000000794000000000000000000000000000407f400000000000c072400000 \
     0000000000000000000000000000000000000000f03f94749462652e";
    pub(in crate::data) const POSE: [f64; 12] = [
        1.0, 0.0, 0.0, 0.25, 0.0, -1.0, 0.0, -0.5, 0.0, 0.0, -1.0, 2.0,
    ];
    pub(in crate::data) const LENS: [f64; 9] =
        [500.0, 0.0, 400.0, 0.0, 500.0, 300.0, 0.0, 0.0, 1.0];

    pub(in crate::data) fn bytes_of(hex: &str) -> Vec<u8> {
        let digits: Vec<u32> = hex.chars().filter_map(|c| c.to_digit(16)).collect();
        let pairs = digits.chunks_exact(2);
        pairs.map(|pair| (16 * pair[0] + pair[1]) as u8).collect()
    }

    #[test]
    fn arrays_of_every_protocol_are_read() {
        for hex in [PROTOCOL_2, PROTOCOL_4, PROTOCOL_5, FORTRAN] {
            let arrays = arrays(&bytes_of(hex)).unwrap();
            assert_eq!(arrays.len(), 2, "a pose and a lens");
            for (array, shape, values) in
                [(&arrays[0], [3, 4], &POSE[..]), (&arrays[1], [3, 3], &LENS)]
            {
                assert_eq!((&array.shape[..], &array.values[..]), (&shape[..], values));
            }
        }
    }

    #[test]
    fn programs_are_not_run() {
        // os.system("true"), as `pickle` would write it.
        let program = b"\x80\x02cposix\nsystem\nX\x04\0\0\0true\x85R.";
        let problem = arrays(program).unwrap_err();
        assert!(problem.contains("posix.system"), "{problem}");
        let object = b"\x80\x02c__main__\nX\n)\x81.";
        assert!(arrays(object).unwrap_err().contains("0x81"), "objects");
    }

    #[test]
    fn pickles_that_are_cut_or_bent_are_errors_or_smaller() {
        for hex in [PROTOCOL_2, PROTOCOL_4, PROTOCOL_5] {
            let whole = bytes_of(hex);
            for n in 0..whole.len() {
                assert!(arrays(&whole[..n]).is_err(), "cut at {n}");
                for bit in 0..8 {
                    let mut bent = whole.clone();
                    bent[n] ^= 1 << bit;
                    if let Ok(arrays) = arrays(&bent) {
                        let n_values: usize = arrays.iter().map(|a| a.values.len()).sum();
                        assert!(n_values <= whole.len(), "bit {bit} of {n}");
                    }
                }
            }
        }
    }

    #[test]
    fn lists_that_hold_themselves_come_to_an_end() {
        // x = []; x.append(x)
        assert!(arrays(b"]q\0h\0a.").is_err(), "itself");
        // Each level holds the one below a hundred times.
        let mut bytes = b"]q\0".to_vec();
        for level in 1..8_u8 {
            bytes.extend([b']', b'q', level, b'(']);
            bytes.extend([b'h', level - 1].repeat(100));
            bytes.push(b'e');
        }
        bytes.push(b'.');
        assert!(arrays(&bytes).is_err(), "without end");
    }
}
