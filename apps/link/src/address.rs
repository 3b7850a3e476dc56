//! Addresses at which two processes meet, and the streams between them.

use crate::error::{Error, Result};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
#[cfg(unix)]
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Environment variable that passes the address to a command that a run starts.
pub const VARIABLE: &str = "ARLEQUIN_LINK";

/// An address: `unix:PATH`, `tcp:127.0.0.1:PORT`, or `tcp-open:IP:PORT`.
///
/// `tcp` accepts addresses of this machine only. The protocol has no password and no encryption; `tcp-open`
/// allows it on a network that is closed to strangers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// A socket in the file system: whoever may open the file may connect.
    Unix(PathBuf),
    /// An IP address and a port.
    Tcp(SocketAddr),
}

impl std::str::FromStr for Address {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong = |rule: &str| Error::Address {
            address: text.to_owned(),
            rule: rule.to_owned(),
        };
        let form = "must be unix:PATH or tcp:127.0.0.1:PORT";
        let (scheme, location) = text.split_once(':').ok_or_else(|| wrong(form))?;
        match scheme {
            "unix" if location.is_empty() => Err(wrong("has no path; write unix:PATH")),
            "unix" if cfg!(unix) => Ok(Self::Unix(PathBuf::from(location))),
            "unix" => Err(wrong("this system has no such sockets; write tcp:127.0.0.1:PORT")),
            "tcp" | "tcp-open" => {
                // The one name that is allowed: it is the loopback address on every machine, without a
                // look-up.
                let localhost = location
                    .strip_prefix("localhost:")
                    .map(|port| format!("{}:{port}", Ipv4Addr::LOCALHOST));
                let socket: SocketAddr = localhost
                    .as_deref()
                    .unwrap_or(location)
                    .parse()
                    .map_err(|_| wrong("needs an IP address and a port, as in tcp:127.0.0.1:7007"))?;
                // Refused here, not at the connection: a listener open to a network would be open at once.
                if scheme == "tcp" && !socket.ip().is_loopback() {
                    return Err(wrong(
                        "is not of this machine, and the protocol has no password; on a network that is closed to strangers, \
                         write tcp-open in place of tcp",
                    ));
                }
                Ok(Self::Tcp(socket))
            }
            _ => Err(wrong(form)),
        }
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
            Self::Tcp(at) if at.ip().is_loopback() => write!(f, "tcp:{at}"),
            Self::Tcp(at) => write!(f, "tcp-open:{at}"),
        }
    }
}

/// Returns the address in [`VARIABLE`], which a run sets for the command it starts.
pub fn given() -> Option<String> {
    std::env::var(VARIABLE).ok()
}

fn system(what: &str, address: &Address) -> impl Fn(std::io::Error) -> Error {
    let what = format!("{what} {address}");
    move |e| Error::System {
        what: what.clone(),
        reason: e.to_string(),
    }
}

/// A stream over either kind of socket.
#[derive(Debug)]
pub(crate) enum Stream {
    #[cfg(unix)]
    Unix(UnixStream),
    Tcp(TcpStream),
}

impl Stream {
    /// Connects to a waiting run.
    pub(crate) fn connect(address: &Address) -> Result<Self> {
        let failed = system("connecting to", address);
        match address {
            #[cfg(unix)]
            Address::Unix(path) => UnixStream::connect(path).map(Self::Unix).map_err(failed),
            #[cfg(not(unix))]
            Address::Unix(_) => Err(failed(std::io::ErrorKind::Unsupported.into())),
            Address::Tcp(at) => TcpStream::connect(at)
                .and_then(|s| s.set_nodelay(true).map(|()| s))
                .map(Self::Tcp)
                .map_err(failed),
        }
    }

    /// Limits the time of the next reads.
    pub(crate) fn read_within(&self, limit: Duration) -> std::io::Result<()> {
        match self {
            #[cfg(unix)]
            Self::Unix(s) => s.set_read_timeout(Some(limit)),
            Self::Tcp(s) => s.set_read_timeout(Some(limit)),
        }
    }

    /// Limits the time of the next writes.
    pub(crate) fn write_within(&self, limit: Duration) -> std::io::Result<()> {
        match self {
            #[cfg(unix)]
            Self::Unix(s) => s.set_write_timeout(Some(limit)),
            Self::Tcp(s) => s.set_write_timeout(Some(limit)),
        }
    }
}

impl Read for Stream {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        match self {
            #[cfg(unix)]
            Self::Unix(s) => s.read(buf),
            Self::Tcp(s) => s.read(buf),
        }
    }
}

impl Write for Stream {
    fn write(&mut self, buf: &[u8]) -> std::io::Result<usize> {
        match self {
            #[cfg(unix)]
            Self::Unix(s) => s.write(buf),
            Self::Tcp(s) => s.write(buf),
        }
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Listens at a path. A socket there at which nobody listens is replaced.
#[cfg(unix)]
fn bind(path: &Path) -> std::io::Result<UnixListener> {
    use std::io::ErrorKind::{AddrInUse, ConnectionRefused};
    use std::os::unix::fs::FileTypeExt;
    // Only a refusal for this reason may be a socket that a killed run left behind.
    let in_use = match UnixListener::bind(path) {
        Err(e) if e.kind() == AddrInUse => e,
        other => return other,
    };
    // Of the file itself, not of where a link leads.
    let is_socket = std::fs::symlink_metadata(path).is_ok_and(|m| m.file_type().is_socket());
    // A datagram socket is of another type than the listener: its attempt to connect shows whether somebody
    // listens, and the listener never sees it.
    match UnixDatagram::unbound()?.connect(path) {
        // Refused: nobody listens. Only then is the file removed, and only if it is a socket.
        Err(e) if is_socket && e.kind() == ConnectionRefused => {
            std::fs::remove_file(path)?;
            UnixListener::bind(path)
        }
        _ => Err(in_use),
    }
}

#[derive(Debug)]
enum Door {
    #[cfg(unix)]
    Unix(UnixListener),
    Tcp(TcpListener),
}

/// An address at which a run waits for the other side. Its socket file and private folder are removed with
/// it.
#[derive(Debug)]
pub struct Listener {
    door: Door,
    address: Address,
    /// Socket file to remove.
    socket_file: Option<PathBuf>,
    /// Private folder to remove.
    folder: Option<PathBuf>,
}

/// Pause between two checks for a connection.
const GLANCE: Duration = Duration::from_millis(1);

impl Listener {
    /// Starts listening at an address.
    ///
    /// # Errors
    /// [`Error::System`], for example if the address is in use.
    pub fn bind(address: &Address) -> Result<Self> {
        let failed = system("waiting at", address);
        let mut socket_file = None;
        let mut bound = address.clone();
        let door = match address {
            #[cfg(unix)]
            Address::Unix(path) => {
                let listener = bind(path).map_err(&failed)?;
                socket_file = Some(path.clone());
                // The wait must look at the deadline, at Ctrl-C and at the process meanwhile.
                listener.set_nonblocking(true).map_err(&failed)?;
                Door::Unix(listener)
            }
            #[cfg(not(unix))]
            Address::Unix(_) => return Err(failed(std::io::ErrorKind::Unsupported.into())),
            Address::Tcp(socket) => {
                let listener = TcpListener::bind(socket).map_err(&failed)?;
                listener.set_nonblocking(true).map_err(&failed)?;
                bound = Address::Tcp(listener.local_addr().map_err(&failed)?);
                Door::Tcp(listener)
            }
        };
        let (address, folder) = (bound, None);
        Ok(Self {
            door,
            address,
            socket_file,
            folder,
        })
    }

    /// Starts listening at an address that nobody else knows: a socket in a new folder that only this user
    /// may enter. On systems without such sockets it is a free port of the loopback interface.
    ///
    /// # Errors
    /// [`Error::System`].
    pub fn private() -> Result<Self> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::DirBuilderExt;
            use std::sync::atomic::{AtomicU64, Ordering};
            static NEXT: AtomicU64 = AtomicU64::new(0);
            let base = std::env::temp_dir();
            loop {
                let number = NEXT.fetch_add(1, Ordering::Relaxed);
                let folder = base.join(format!("arlequin-{}-{number}", std::process::id()));
                // Mode 0700: nobody else can reach the socket in it, whatever the socket's own mode.
                match std::fs::DirBuilder::new().mode(0o700).create(&folder) {
                    // A killed process with the same number has left this folder.
                    Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
                    Err(e) => {
                        return Err(Error::System {
                            what: format!("making folder {}", folder.display()),
                            reason: e.to_string(),
                        });
                    }
                    Ok(()) => {
                        let listener = Self::bind(&Address::Unix(folder.join("link")));
                        if listener.is_err() {
                            let _ = std::fs::remove_dir(&folder);
                        }
                        return listener.map(|mut l| {
                            l.folder = Some(folder);
                            l
                        });
                    }
                }
            }
        }
        #[cfg(not(unix))]
        Self::bind(&Address::Tcp(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))))
    }

    /// Returns the address, with the port that the system has chosen if none was given.
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// Accepts the first connection, until the deadline `until`. Between the checks `watch` may end the wait
    /// by an error.
    pub(crate) fn accept(
        &self,
        until: Instant,
        watch: &mut dyn FnMut() -> Result<()>,
    ) -> Result<Option<Stream>> {
        let failed = system("waiting at", &self.address);
        loop {
            let attempt = match &self.door {
                #[cfg(unix)]
                Door::Unix(l) => l.accept().and_then(|(s, _)| {
                    // Some systems pass the listener's mode on to the stream.
                    s.set_nonblocking(false)?;
                    Ok(Stream::Unix(s))
                }),
                Door::Tcp(l) => l.accept().and_then(|(s, _)| {
                    s.set_nonblocking(false)?;
                    // Messages are small and each waits for its answer: without this TCP would hold them
                    // back.
                    s.set_nodelay(true)?;
                    Ok(Stream::Tcp(s))
                }),
            };
            match attempt {
                Ok(stream) => return Ok(Some(stream)),
                Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => {}
                // A signal that is handled elsewhere is no end of the wait.
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(failed(e)),
            }
            watch()?;
            if Instant::now() >= until {
                return Ok(None);
            }
            std::thread::sleep(GLANCE);
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let Some(path) = &self.socket_file {
            let _ = std::fs::remove_file(path);
        }
        if let Some(path) = &self.folder {
            let _ = std::fs::remove_dir(path);
        }
    }
}
