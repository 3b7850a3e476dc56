//! Errors of models implemented outside the core.

use super::Error;
use std::sync::Arc;

impl Error {
    /// Shorthand for [`Self::Model`].
    pub fn of_model(name: &str, error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::Model {
            model: name.to_owned(),
            source: ModelError(Arc::new(error)),
        }
    }
}

/// An error of a model implemented outside the core, of a type that only that model knows.
#[derive(Debug, Clone)]
pub struct ModelError(Arc<dyn std::error::Error + Send + Sync>);

impl ModelError {
    /// The error itself, if it is of this type.
    pub fn downcast_ref<E: std::error::Error + 'static>(&self) -> Option<&E> {
        self.0.downcast_ref()
    }
}

impl std::fmt::Display for ModelError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl std::error::Error for ModelError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source()
    }
}

/// Equal where they say the same.
impl PartialEq for ModelError {
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}
