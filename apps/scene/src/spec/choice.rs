//! Choices: tables with exactly one key, or words, with errors in terms of a scene.

/// Implements `Deserialize` for an enum that derives it with `#[serde(remote = "Self")]`. Accepts a table
/// with exactly one key, or a word for a variant without fields; errors for other input list the choices.
macro_rules! choice {
    ($choice:ty, $words:literal) => {
        impl<'de> serde::Deserialize<'de> for $choice {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Choice;
                impl<'de> serde::de::Visitor<'de> for Choice {
                    type Value = $choice;
                    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                        f.write_str(concat!("exactly one of ", $words))
                    }
                    fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<$choice, E> {
                        let word_deserializer = serde::de::value::StrDeserializer::<serde::de::value::Error>::new(word);
                        <$choice>::deserialize(word_deserializer)
                            .map_err(|_| E::invalid_value(serde::de::Unexpected::Str(word), &self))
                    }
                    fn visit_map<A: serde::de::MapAccess<'de>>(
                        self,
                        mut map: A,
                    ) -> Result<$choice, A::Error> {
                        // The derived function would say "expected enum".
                        if map.size_hint() == Some(0) {
                            return Err(serde::de::Error::custom(concat!(
                                "is empty, expected exactly one of ",
                                $words
                            )));
                        }
                        // `remote = "Self"` makes the derived function an inherent one, so that this is no
                        // recursion. It reads one key and ignores what follows.
                        let map_deserializer = serde::de::value::MapAccessDeserializer::new(&mut map);
                        let value = <$choice>::deserialize(map_deserializer)?;
                        match map.next_key::<String>()? {
                            None => Ok(value),
                            Some(other) => Err(serde::de::Error::custom(format_args!(
                                "'{other}' is one key too many, expected exactly one of {}; to exchange a choice, set \
                                 the whole table",
                                $words
                            ))),
                        }
                    }
                }
                deserializer.deserialize_any(Choice)
            }
        }
    };
}

pub(super) use choice;
