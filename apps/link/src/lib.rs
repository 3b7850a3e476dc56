//! Solvers in other processes as participants of an Arlequin coupling: a small protocol over Unix sockets and
//! the loopback interface, with both of its ends.
//!
//! [`Remote`] is the run's end: it starts a command or waits at an [`Address`], and acts as a [`Participant`]
//! like a solver in the same process. [`serve`] is the solver's end in Rust: it serves any [`Participant`],
//! and [`Verlet`] makes a participant of any [`Model`](arlequin_core::Model). Clients in Python (numpy alone)
//! and C are in `clients/`; `docs/link.md` of the repository describes the protocol byte by byte.
//!
//! Nothing that the other side sends is trusted: lengths are compared with a limit before memory is
//! allocated, numbers must be finite, and every wait has an end. Received bytes are data; none are ever
//! executed.
//!
//! # A chain in its own thread, behind a socket
//!
//! ```
//! use arlequin_core::{Model, Participant, Weights};
//! use arlequin_link::{Element, Listener, Options, Remote, Shape, Verlet, serve};
//! use spring_chain::Chain;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let listener = Listener::private()?;
//! let address = listener.address().clone();
//! let other = std::thread::spawn(move || -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
//!     let chain = Chain::new("chain", 0.0, 0.1, 10, 1.0, 1.0)?;
//!     let mut solver = Verlet::new(Box::new(chain), vec![0.0; 11], vec![1.0; 11])?;
//!     let lines = (0..10).flat_map(|k| [k, k + 1]).collect();
//!     let shape = Shape::Mesh { element: Element::Line, connectivity: lines, section: 1.0 };
//!     Ok(serve(&address, &mut solver, &shape)?)
//! });
//! let mut solver = Remote::accept("fine", &listener, Options::default())?;
//! assert_eq!(solver.nodes().len(), 11);
//! let mut mass = vec![0.0; 11];
//! solver.weigh(&Weights::uncoupled(), &mut mass)?;
//! solver.advance(0.0, 0.5)?;
//! let mut velocities = vec![0.0; 11];
//! solver.velocities(&mut velocities);
//! assert_eq!((mass[5], velocities[5]), (1.0, 1.0));
//! drop(solver);
//! other.join().expect("no panic").expect("an orderly end");
//! # Ok(())
//! # }
//! ```

#[cfg(doc)]
use arlequin_core::Participant;

mod address;
mod channel;
mod child;
mod error;
mod link;
mod message;
mod remote;
mod serve;
mod verlet;
pub mod wire;

pub use address::{Address, Listener, VARIABLE, given};
pub use child::shown;
pub use error::{Error, Result};
pub use message::{Ask, Description, Element, Fields, Places, Shape, read_record, write_record};
pub use remote::{Options, Remote};
pub use serve::serve;
pub use verlet::Verlet;
