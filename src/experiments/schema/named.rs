//! Lists of named tables.

use std::fmt;
use std::marker::PhantomData;

use serde::de::value::SeqAccessDeserializer;
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use toml::Spanned;

pub(super) trait Named {
    fn set_name(&mut self, name: String);
}

/// A list of tables, each with its name among its keys, or a table of them by their names; in the order of the file.
pub(super) fn tables<'de, D, T>(deserializer: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de> + Named,
{
    deserializer.deserialize_any(Tables(PhantomData))
}

struct Tables<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de> + Named> Visitor<'de> for Tables<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of tables, or a table of them by their names")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Vec<T>, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut named: A) -> Result<Vec<T>, A::Error> {
        let mut tables = Vec::new();
        while let Some((name, mut table)) = named.next_entry::<Spanned<String>, T>()? {
            let offset = name.span().start;
            table.set_name(name.into_inner());
            tables.push((offset, table));
        }
        // They come sorted by their names.
        tables.sort_by_key(|(offset, _)| *offset);
        Ok(tables.into_iter().map(|(_, table)| table).collect())
    }
}
