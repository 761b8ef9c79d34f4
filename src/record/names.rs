//! Names that many records share: of stages, errors, units, counters. A name is held once, by whatever number of records.

use std::borrow::Borrow;
use std::cell::RefCell;
use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::ops::Deref;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};

/// Names, and groups of parameters, that are remembered to be shared. Beyond that it begins again: a file of records may be anyone's.
pub(super) const MOST_KNOWN: usize = 1 << 14;

thread_local! {
    static KNOWN: RefCell<HashSet<Name>> = RefCell::default();
}

/// A name. Copies of it share its text.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize, JsonSchema)]
#[serde(from = "String")]
#[schemars(with = "String", inline, description = "")]
pub struct Name(Arc<str>);

impl Name {
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl From<&str> for Name {
    fn from(text: &str) -> Self {
        KNOWN.with_borrow_mut(|known| {
            if let Some(name) = known.get(text) {
                return name.clone();
            }
            if known.len() > MOST_KNOWN {
                known.clear();
            }
            let name = Self(text.into());
            known.insert(name.clone());
            name
        })
    }
}

impl From<String> for Name {
    fn from(text: String) -> Self {
        text.as_str().into()
    }
}

impl Deref for Name {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl Borrow<str> for Name {
    fn borrow(&self) -> &str {
        self
    }
}

impl PartialEq<str> for Name {
    fn eq(&self, other: &str) -> bool {
        **self == *other
    }
}

impl PartialEq<&str> for Name {
    fn eq(&self, other: &&str) -> bool {
        **self == **other
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&**self, f)
    }
}

impl Serialize for Name {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self)
    }
}

/// Values by name, in the order of the names. Small: a [`BTreeMap`] has room for eleven from the first on.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(from = "BTreeMap<String, V>")]
#[schemars(with = "BTreeMap<String, V>", inline, description = "")]
pub struct Named<V>(Vec<(Name, V)>);

impl<V> Named<V> {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn get(&self, name: &str) -> Option<&V> {
        self.place(name).ok().map(|place| &self.0[place].1)
    }

    /// Replaces what has this name.
    pub fn insert(&mut self, name: impl Into<Name>, value: V) {
        let name = name.into();
        match self.place(&name) {
            Ok(place) => self.0[place].1 = value,
            Err(place) => self.0.insert(place, (name, value)),
        }
    }

    pub fn iter(&self) -> impl Iterator<Item = (&Name, &V)> {
        self.0.iter().map(|(name, value)| (name, value))
    }

    pub fn to_map(&self) -> BTreeMap<String, V>
    where
        V: Clone,
    {
        self.iter().map(|(name, value)| (name.to_string(), value.clone())).collect()
    }

    fn place(&self, name: &str) -> Result<usize, usize> {
        self.0.binary_search_by(|(known, _)| known.as_str().cmp(name))
    }
}

impl<V> From<BTreeMap<String, V>> for Named<V> {
    fn from(map: BTreeMap<String, V>) -> Self {
        Self(map.into_iter().map(|(name, value)| (name.into(), value)).collect())
    }
}

impl<V: Serialize> Serialize for Named<V> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_names_share_their_text() {
        let [one, other] = [Name::from("a/b"), Name::from("a/b".to_owned())];
        assert!(Arc::ptr_eq(&one.0, &other.0));
        assert!(one == "a/b" && one != "a/c" && format!("{one}") == "a/b");
    }

    #[test]
    fn no_more_names_are_remembered_than_may_be() {
        for n in 0..3 * MOST_KNOWN {
            let _ = Name::from(n.to_string());
        }
        assert!(KNOWN.with_borrow(HashSet::len) <= MOST_KNOWN + 1);
    }

    #[test]
    fn values_come_back_in_the_order_of_their_names_and_the_last_holds() {
        let read: Named<u32> = serde_json::from_str(r#"{"b":1,"a":2,"b":3}"#).unwrap();
        assert_eq!(serde_json::to_string(&read).unwrap(), r#"{"a":2,"b":3}"#);
        assert_eq!((read.get("b"), read.get("c"), read.is_empty()), (Some(&3), None, false));
        let mut made = Named::default();
        for (name, value) in [("b", 1), ("a", 2), ("b", 3)] {
            made.insert(name, value);
        }
        assert_eq!(made, read);
        assert_eq!(Named::from(read.to_map()), read);
    }
}
