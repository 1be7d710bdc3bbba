//! The stack machine of Python's pickles: plain values built step by step, nothing run.
//!
//! A pickle is a program for a small stack machine (`Lib/pickletools.py`). Only what builds plain values is known here, in
//! protocols 1 to 5. What a function, an object's state or a persistent id makes of its arguments is the affair of an
//! [`Object`], which looks names up in its own short list. What a file makes is no larger than its bytes allow: values
//! are shared, never copied.

use std::collections::HashMap;

/// A value on the machine's stack: a place in its memory.
pub(crate) type Place = usize;

/// A value that a pickle describes.
#[derive(Clone, Debug)]
pub(crate) enum Value<T> {
    /// None, and numbers with a fraction that stand in no array: nothing asks for them.
    None,
    Int(i64),
    Bytes(Vec<u8>),
    Text(String),
    /// A tuple, list or set, or a dictionary (keys and values in turn).
    Items(Vec<Place>),
    /// A function by its module and name.
    Name(String),
    Object(T),
}

/// Dimensions of an array.
const MAX_DIMENSIONS: usize = 8;

impl<T> Value<T> {
    /// The sides of an array: whole numbers in a tuple or list, none below zero; `None` where it is anything else.
    pub(crate) fn shape(&self, values: &[Self]) -> Option<Vec<usize>> {
        let Self::Items(sides) = self else {
            return None;
        };
        let side = |place: &Place| match values[*place] {
            Self::Int(side) => usize::try_from(side).ok(),
            _ => None,
        };
        let is_sane = sides.len() <= MAX_DIMENSIONS;
        is_sane.then(|| sides.iter().map(side).collect()).flatten()
    }
}

/// What a library's functions make of plain values.
pub(crate) trait Object: Sized {
    /// What the function of that name returns; `values`: what places mean.
    fn call(
        name: &str,
        arguments: &[&Value<Self>],
        values: &[Value<Self>],
    ) -> Result<Value<Self>, String>;

    /// What `target` becomes with that state; `None`: stays as it is.
    fn build(
        target: &Value<Self>,
        state: &[&Value<Self>],
        values: &[Value<Self>],
    ) -> Result<Option<Value<Self>>, String>;

    /// What lies outside the pickle under that id.
    fn persistent(id: &[&Value<Self>]) -> Result<Value<Self>, String>;
}

/// What a pickle made.
#[derive(Debug)]
pub(crate) struct Unpickled<T> {
    /// What places mean.
    pub(crate) values: Vec<Value<T>>,
    /// The place of the result.
    pub(crate) top: Place,
    /// Bytes of the pickle.
    pub(crate) n_bytes: usize,
}

/// Reads the pickle at the start of `bytes`, or what is wrong with it.
pub(crate) fn unpickle<T: Object>(bytes: &[u8]) -> Result<Unpickled<T>, String> {
    let mut machine = Machine {
        rest: bytes,
        values: Vec::new(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: HashMap::new(),
    };
    let top = machine.run()?;
    Ok(Unpickled {
        n_bytes: bytes.len() - machine.rest.len(),
        values: machine.values,
        top,
    })
}

struct Machine<'a, T> {
    rest: &'a [u8],
    values: Vec<Value<T>>,
    stack: Vec<Place>,
    /// Heights of the stack.
    marks: Vec<usize>,
    memo: HashMap<usize, Place>,
}

fn cut() -> String {
    "the file ends early".to_owned()
}

impl<T: Object> Machine<'_, T> {
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

    fn push(&mut self, value: Value<T>) {
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
        self.memo.insert(key, top);
        Ok(())
    }

    fn recall(&mut self, key: usize) -> Result<(), String> {
        let place = self.memo.get(&key);
        let place = place.ok_or("it recalls what it never remembered")?;
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
                b')' | b']' | b'}' | 0x8f => self.push(Value::Items(Vec::new())),
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
                b'e' | b'u' | 0x90 => {
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
                // REDUCE, NEWOBJ
                b'R' | 0x81 => self.call()?,
                b'b' => self.build()?,
                b'Q' => self.push_persistent()?,
                _ => return Err(format!("operation 0x{code:02x} is none of plain values")),
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
            // A number with a fraction.
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

    /// The values of a tuple.
    fn items(&self, place: Place) -> Option<Vec<&Value<T>>> {
        match &self.values[place] {
            Value::Items(items) => Some(items.iter().map(|place| &self.values[*place]).collect()),
            _ => None,
        }
    }

    /// What a function makes of its arguments.
    fn call(&mut self) -> Result<(), String> {
        let (arguments, function) = (self.pop()?, self.pop()?);
        let Value::Name(name) = &self.values[function] else {
            return Err("it calls what is no function".to_owned());
        };
        let arguments = self.items(arguments);
        let arguments = arguments.ok_or_else(|| format!("{name} is called without arguments"))?;
        let value = T::call(name, &arguments, &self.values)?;
        self.push(value);
        Ok(())
    }

    /// Gives what is on top its state.
    fn build(&mut self) -> Result<(), String> {
        let state = self.pop()?;
        let target = *self.stack.last().ok_or("it builds nothing")?;
        let state = self.items(state);
        let state = state.ok_or("the state of an object is no tuple")?;
        if let Some(built) = T::build(&self.values[target], &state, &self.values)? {
            self.values[target] = built;
        }
        Ok(())
    }

    fn push_persistent(&mut self) -> Result<(), String> {
        let id = self.pop()?;
        let id = self.items(id).ok_or("a persistent id is no tuple")?;
        let value = T::persistent(&id)?;
        self.push(value);
        Ok(())
    }
}
