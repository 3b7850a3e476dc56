//! Enums whose variants have names in scenes and reports.

/// Gives an enum the lists `ALL` and `NAMES`, the method `name`, `Display`, `FromStr`, and `Deserialize` with
/// the feature `serde`.
macro_rules! named {
    ($kind:ident, $what:literal: $($variant:ident = $name:literal),+ $(,)?) => {
        impl $kind {
            /// All variants.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];
            /// Names of the variants, in the order of [`Self::ALL`].
            pub const NAMES: &'static [&'static str] = &[$($name),+];

            /// Name of the variant.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name),+
                }
            }
        }

        impl std::fmt::Display for $kind {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $kind {
            type Err = $crate::Error;

            fn from_str(name: &str) -> $crate::Result<Self> {
                let variant = Self::ALL.iter().copied().find(|k| k.name() == name);
                variant.ok_or_else(|| {
                    let rule = format!("must be one of {}", Self::NAMES.join(", "));
                    $crate::error::invalid($what, format_args!("'{name}'"), &rule)
                })
            }
        }

        #[cfg(feature = "serde")]
        impl<'de> serde::Deserialize<'de> for $kind {
            fn deserialize<D: serde::Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
                let name = String::deserialize(from)?;
                let unknown = |_| serde::de::Error::unknown_variant(&name, Self::NAMES);
                name.parse().map_err(unknown)
            }
        }
    };
}

pub(crate) use named;
