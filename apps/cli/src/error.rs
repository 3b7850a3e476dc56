//! Errors on the terminal: with the place in the scene they come from.

pub(crate) use arlequin_scene::error::*;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use arlequin_scene::Source;
use std::process::ExitCode;

/// An error and the text it may point into.
#[derive(Debug)]
pub(crate) struct Located {
    error: Error,
    source: Option<Box<Source>>,
}

impl From<Error> for Located {
    fn from(error: Error) -> Self {
        Self { error, source: None }
    }
}

impl Located {
    /// Points into a text.
    pub(crate) fn within(source: &Source) -> impl FnOnce(Error) -> Self {
        let source = Some(Box::new(source.clone()));
        |error| Self { error, source }
    }

    /// Shows the error; the code to exit with.
    pub(crate) fn report(&self) -> ExitCode {
        crate::report::error(&render(&self.error, self.source.as_deref()));
        self.code()
    }

    /// The code to exit with.
    pub(crate) fn code(&self) -> ExitCode {
        ExitCode::from(match self.error.is_input() {
            _ if crate::run::is_interrupted() => crate::run::INTERRUPTED,
            true => 2,
            false => 1,
        })
    }
}

/// On several ranks.
#[cfg(feature = "mpi")]
impl Located {
    /// Whether all ranks know of it.
    pub(crate) fn is_everywhere(&self) -> bool {
        self.error.is_everywhere()
    }

    /// Shows an error that all ranks know of, on the one whose it is; the code to exit with.
    pub(crate) fn report_once(&self) -> ExitCode {
        let own = match self.error {
            Error::Agreed(_) => true,
            Error::Elsewhere { .. } => false,
            _ => crate::ranks::leads(),
        };
        if own { self.report() } else { self.code() }
    }

    /// In one line, for other ranks too.
    pub(crate) fn plain(&self) -> String {
        self.error.to_string()
    }
}

/// Shows an error with the place in the scene it comes from.
fn render(error: &Error, source: Option<&Source>) -> String {
    let (key, span) = error.place();
    let span = span.or_else(|| source.and_then(|s| s.span_of(key?)));
    let message = error.to_string();
    let title = Level::ERROR.primary_title(&message);
    let shown = match (source, span) {
        (Some(s), Some(span)) => {
            let here = AnnotationKind::Primary.span(span).label(key);
            let path = s.path.display().to_string();
            let lines = Snippet::source(&s.text).path(path).annotation(here);
            Renderer::plain().render(&[title.element(lines)])
        }
        _ => Renderer::plain().render(&[Group::with_title(title)]),
    };
    shown + "\n"
}
