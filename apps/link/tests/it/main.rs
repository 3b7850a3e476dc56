//! Tests of links, in one program: one link instead of 6.

mod clients;
mod equal;
mod greetings;
mod precision;
mod strangers;
mod support;
