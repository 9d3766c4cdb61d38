//! Structs from maps alone: serde would also take the list of a struct's fields.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};

/// A struct that came as a map.
pub struct AsMap<T>(pub T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for AsMap<T> {
    fn deserialize<D: Deserializer<'de>>(value: D) -> Result<Self, D::Error> {
        value.deserialize_map(OfMap(PhantomData)).map(Self)
    }
}

pub fn as_map<'de, D: Deserializer<'de>, T: Deserialize<'de>>(value: D) -> Result<T, D::Error> {
    AsMap::deserialize(value).map(|AsMap(read)| read)
}

/// What may be left out, but not be nil.
pub fn as_some_map<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    value: D,
) -> Result<Option<T>, D::Error> {
    as_map(value).map(Some)
}

pub fn as_maps<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    value: D,
) -> Result<Vec<T>, D::Error> {
    let maps: Vec<AsMap<T>> = Vec::deserialize(value)?;
    Ok(maps.into_iter().map(|AsMap(read)| read).collect())
}

pub fn as_named_maps<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    value: D,
) -> Result<BTreeMap<String, T>, D::Error> {
    let maps: BTreeMap<String, AsMap<T>> = BTreeMap::deserialize(value)?;
    Ok(maps.into_iter().map(|(name, AsMap(read))| (name, read)).collect())
}

struct OfMap<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for OfMap<T> {
    type Value = T;

    fn expecting(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        text.write_str("a map")
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
        T::deserialize(MapAccessDeserializer::new(map))
    }
}
