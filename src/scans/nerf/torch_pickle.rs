//! Pickles of `torch.save`: which tensors they name, and where each one's numbers lie.
//!
//! Names are looked up in a list of four of torch's functions and its kinds of storage (`torch/_utils.py`,
//! `torch/serialization.py`); whatever else a pickle calls becomes a value that says nothing. Nothing is run.

use std::collections::BTreeMap;

use crate::data::files::pickle_machine::{Object, Place, Unpickled, Value, unpickle};

/// Values looked at in the result: a list may hold itself, or one list a thousand times over.
const MAX_VISITS: usize = 1_000_000;
/// Dictionaries within dictionaries that are looked into.
const MAX_DEPTH: usize = 12;

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NumberKind {
    F16,
    Bf16,
    F32,
    F64,
    I64,
    /// Of a size in bytes, not read.
    Other(usize),
}

impl NumberKind {
    /// By the name of torch's storage.
    fn of(storage: &str) -> Option<Self> {
        Some(match storage.rsplit('.').next()? {
            "HalfStorage" => Self::F16,
            "BFloat16Storage" => Self::Bf16,
            "FloatStorage" => Self::F32,
            "DoubleStorage" => Self::F64,
            "LongStorage" => Self::I64,
            "IntStorage" => Self::Other(4),
            "ShortStorage" => Self::Other(2),
            "CharStorage" | "ByteStorage" | "BoolStorage" | "UntypedStorage" => Self::Other(1),
            _ => return None,
        })
    }

    /// Bytes of a number.
    pub(super) fn n_bytes(self) -> usize {
        match self {
            Self::F16 | Self::Bf16 => 2,
            Self::F32 => 4,
            Self::F64 | Self::I64 => 8,
            Self::Other(n) => n,
        }
    }
}

/// Numbers in a row that tensors share.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Storage {
    /// What the file calls it.
    pub(super) key: String,
    pub(super) kind: NumberKind,
    /// Numbers in it.
    pub(super) n: usize,
}

/// A tensor: a view of a storage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Tensor {
    pub(super) storage: Storage,
    /// Index of the first number.
    pub(super) offset: usize,
    pub(super) shape: Vec<usize>,
    /// Numbers from one to the next along each side.
    pub(super) strides: Vec<usize>,
}

/// What torch's functions make.
#[derive(Clone, Debug)]
pub(super) enum Made {
    Storage(Storage),
    Tensor(Tensor),
    /// Something else.
    Opaque,
}

impl Object for Made {
    fn call(
        name: &str,
        arguments: &[&Value<Self>],
        values: &[Value<Self>],
    ) -> Result<Value<Self>, String> {
        let made = match (name, arguments) {
            ("collections.OrderedDict", _) => return Ok(Value::Items(Vec::new())),
            (
                "torch._utils._rebuild_tensor_v2" | "torch._utils._rebuild_tensor",
                [
                    Value::Object(Self::Storage(storage)),
                    Value::Int(offset),
                    shape,
                    strides,
                    ..,
                ],
            ) => Self::Tensor(Tensor {
                storage: storage.clone(),
                offset: usize::try_from(*offset)
                    .map_err(|_negative| "a tensor starts before its storage")?,
                shape: self::shape(shape, values)?,
                strides: self::shape(strides, values)?,
            }),
            ("torch._utils._rebuild_parameter", [Value::Object(Self::Tensor(tensor)), ..]) => {
                Self::Tensor(tensor.clone())
            }
            _ => Self::Opaque,
        };
        Ok(Value::Object(made))
    }

    fn build(
        _target: &Value<Self>,
        _state: &[&Value<Self>],
        _values: &[Value<Self>],
    ) -> Result<Option<Value<Self>>, String> {
        // Modules' metadata and the like.
        Ok(None)
    }

    fn persistent(id: &[&Value<Self>]) -> Result<Value<Self>, String> {
        let [
            Value::Text(what),
            Value::Name(kind),
            Value::Text(key),
            _,
            Value::Int(n),
            ..,
        ] = id
        else {
            return Err("a storage is described otherwise than torch does".to_owned());
        };
        if what != "storage" {
            return Err(format!("\"{what}\" lies outside it"));
        }
        Ok(Value::Object(Self::Storage(Storage {
            key: key.clone(),
            kind: NumberKind::of(kind).ok_or_else(|| format!("a storage is a {kind}"))?,
            n: usize::try_from(*n).map_err(|_negative| "a storage has a negative size")?,
        })))
    }
}

fn shape(sides: &Value<Made>, values: &[Value<Made>]) -> Result<Vec<usize>, String> {
    let sides = sides.shape(values);
    sides.ok_or_else(|| "the shape of a tensor is none".to_owned())
}

/// What a pickle says about tensors.
#[derive(Debug)]
pub(super) struct Named {
    /// By the keys that lead to them, joined by points.
    pub(super) tensors: BTreeMap<String, Tensor>,
    /// Sizes of the numbers in storages by key, those included that only nameless tensors have.
    pub(super) sizes: BTreeMap<String, usize>,
    /// Bytes of the pickle.
    pub(super) n_bytes: usize,
}

/// The tensors in a pickle's dictionaries.
pub(super) fn tensors(bytes: &[u8]) -> Result<Named, String> {
    let unpickled: Unpickled<Made> = unpickle(bytes)?;
    let mut tensors = BTreeMap::new();
    let mut n_left = MAX_VISITS;
    let mut found = |key: &str, tensor: &Tensor| {
        tensors.insert(key.to_owned(), tensor.clone());
    };
    let key = &mut String::new();
    collect(&unpickled, unpickled.top, key, 0, &mut found, &mut n_left)?;
    let storages = unpickled.values.iter().filter_map(|value| match value {
        Value::Object(Made::Storage(storage)) => Some(storage),
        _ => None,
    });
    let sizes = storages.map(|storage| (storage.key.clone(), storage.kind.n_bytes()));
    Ok(Named {
        tensors,
        sizes: sizes.collect(),
        n_bytes: unpickled.n_bytes,
    })
}

/// The texts in a pickled list, and the length of the pickle.
pub(super) fn texts(bytes: &[u8]) -> Result<(Vec<String>, usize), String> {
    let unpickled: Unpickled<Made> = unpickle(bytes)?;
    let Value::Items(items) = &unpickled.values[unpickled.top] else {
        return Err("the list of storages is none".to_owned());
    };
    let text = |place: &Place| match &unpickled.values[*place] {
        Value::Text(text) => Ok(text.clone()),
        _ => Err("the key of a storage is no text".to_owned()),
    };
    let texts = items.iter().map(text).collect::<Result<Vec<_>, _>>()?;
    Ok((texts, unpickled.n_bytes))
}

/// The length of a pickle that says nothing of interest.
pub(super) fn length(bytes: &[u8]) -> Result<usize, String> {
    let unpickled: Unpickled<Made> = unpickle(bytes)?;
    Ok(unpickled.n_bytes)
}

/// Hands over the tensors in dictionaries with texts for keys; `n_left`: values that may still be looked at.
fn collect(
    unpickled: &Unpickled<Made>,
    place: Place,
    key: &mut String,
    depth: usize,
    found: &mut impl FnMut(&str, &Tensor),
    n_left: &mut usize,
) -> Result<(), String> {
    *n_left = n_left
        .checked_sub(1)
        .ok_or("dictionaries within dictionaries without end")?;
    match &unpickled.values[place] {
        Value::Object(Made::Tensor(tensor)) => found(key, tensor),
        Value::Items(items) if depth < MAX_DEPTH => {
            for pair in items.chunks_exact(2) {
                if let Value::Text(name) = &unpickled.values[pair[0]] {
                    let n = key.len();
                    if n > 0 {
                        key.push('.');
                    }
                    key.push_str(name);
                    collect(unpickled, pair[1], key, depth + 1, found, n_left)?;
                    key.truncate(n);
                }
            }
        }
        _ => {}
    }
    Ok(())
}
