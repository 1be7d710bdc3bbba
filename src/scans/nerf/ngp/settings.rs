//! A snapshot's settings: values by their keys, and messages that name the keys which lead to a wrong one.

use glam::Vec3;
use rmpv::ValueRef;

/// A value among the settings and the keys that lead to it.
pub(super) struct Settings<'a> {
    pub(super) value: &'a ValueRef<'a>,
    pub(super) name: String,
}

fn text_of<'a>(value: &'a ValueRef<'a>) -> Option<&'a str> {
    match value {
        ValueRef::String(text) => text.as_str(),
        _ => None,
    }
}

impl<'a> Settings<'a> {
    /// The value with that key; nil counts as missing.
    pub(super) fn find(&self, key: &str) -> Option<Self> {
        let ValueRef::Map(pairs) = self.value else {
            return None;
        };
        let (_, value) = pairs
            .iter()
            .find(|(k, v)| text_of(k) == Some(key) && *v != ValueRef::Nil)?;
        let dot = if self.name.is_empty() { "" } else { "." };
        Some(Self {
            value,
            name: format!("{}{dot}{key}", self.name),
        })
    }

    pub(super) fn get(&self, key: &str) -> Result<Self, String> {
        let dot = if self.name.is_empty() { "" } else { "." };
        let found = self.find(key);
        found.ok_or_else(|| format!("{}{dot}{key}: missing", self.name))
    }

    pub(super) fn fail(&self, problem: &str) -> String {
        format!("{}: {problem}", self.name)
    }

    pub(super) fn text(&self) -> Result<&'a str, String> {
        let text = text_of(self.value);
        text.ok_or_else(|| self.fail("no text"))
    }

    pub(super) fn number(&self) -> Result<f32, String> {
        let number = match self.value {
            ValueRef::F32(x) => Some(*x),
            ValueRef::F64(x) => Some(*x as f32),
            ValueRef::Integer(n) => n.as_f64().map(|x| x as f32),
            _ => None,
        };
        let number = number.filter(|x| x.is_finite());
        number.ok_or_else(|| self.fail("no number"))
    }

    /// A whole number within bounds, or what it is by default.
    pub(super) fn count(
        &self,
        key: &str,
        default: u32,
        bounds: std::ops::RangeInclusive<u32>,
    ) -> Result<u32, String> {
        let Some(found) = self.find(key) else {
            return Ok(default);
        };
        let count = found.value.as_u64().and_then(|n| u32::try_from(n).ok());
        let count = count.filter(|n| bounds.contains(n));
        count.ok_or_else(|| found.fail(&format!("not a whole number within {bounds:?}")))
    }

    /// Three numbers.
    pub(super) fn vector(&self) -> Result<Vec3, String> {
        let items = self.items()?;
        let [x, y, z] = &items[..] else {
            return Err(self.fail("not three numbers"));
        };
        Ok(Vec3::new(x.number()?, y.number()?, z.number()?))
    }

    pub(super) fn items(&self) -> Result<Vec<Self>, String> {
        let items = self.value.as_array();
        let items = items.ok_or_else(|| self.fail("no list"))?;
        let item = |(i, value)| Self {
            value,
            name: format!("{}[{i}]", self.name),
        };
        Ok(items.iter().enumerate().map(item).collect())
    }

    pub(super) fn bytes(&self) -> Result<&'a [u8], String> {
        match self.value {
            ValueRef::Binary(bytes) | ValueRef::Ext(_, bytes) => Ok(bytes),
            _ => Err(self.fail("no bytes")),
        }
    }

    /// Lower case, as the program compares.
    pub(super) fn kind(&self) -> Result<String, String> {
        Ok(self.get("otype")?.text()?.to_lowercase())
    }
}
