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

/// An error of a model implemented outside the core, of a type that only the model knows.
#[derive(Debug, Clone)]
pub struct ModelError(Arc<dyn std::error::Error + Send + Sync>);

impl ModelError {
    /// Returns the error itself if it has the type `E`.
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

/// Equal if the messages are equal.
impl PartialEq for ModelError {
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}
