//! Where two processes meet, and the streams between them.

use crate::error::{Error, Result};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
#[cfg(unix)]
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Environment variable in which a command that a run starts finds the address.
pub const VARIABLE: &str = "ARLEQUIN_LINK";

/// An address: `unix:PATH`, `tcp:127.0.0.1:PORT`, or `tcp-open:IP:PORT`.
///
/// `tcp` takes addresses of this machine alone. The protocol has no password and no cipher: whoever wants
/// it on a network that is closed to strangers says so with `tcp-open`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// A socket in the file system: who may open the file may speak.
    Unix(PathBuf),
    /// A port.
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
        let (scheme, rest) = text.split_once(':').ok_or_else(|| wrong(form))?;
        match scheme {
            "unix" if rest.is_empty() => Err(wrong("has no path; write unix:PATH")),
            "unix" if cfg!(unix) => Ok(Self::Unix(PathBuf::from(rest))),
            "unix" => Err(wrong("this system has no such sockets; write tcp:127.0.0.1:PORT")),
            "tcp" | "tcp-open" => {
                let named = rest
                    .strip_prefix("localhost:")
                    .map(|port| format!("{}:{port}", Ipv4Addr::LOCALHOST));
                let at: SocketAddr = named
                    .as_deref()
                    .unwrap_or(rest)
                    .parse()
                    .map_err(|_| wrong("needs an IP address and a port, as in tcp:127.0.0.1:7007"))?;
                if scheme == "tcp" && !at.ip().is_loopback() {
                    return Err(wrong(
                        "is not of this machine, and the protocol has no password; on a network that is closed to strangers, \
                         write tcp-open in place of tcp",
                    ));
                }
                Ok(Self::Tcp(at))
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

/// What a process that a run started is told, if it was.
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

/// A stream of either kind.
#[derive(Debug)]
pub(crate) enum Stream {
    #[cfg(unix)]
    Unix(UnixStream),
    Tcp(TcpStream),
}

impl Stream {
    /// Connects to a run that waits.
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

    /// How long a read may take from now on.
    pub(crate) fn read_within(&self, limit: Duration) -> std::io::Result<()> {
        match self {
            #[cfg(unix)]
            Self::Unix(s) => s.set_read_timeout(Some(limit)),
            Self::Tcp(s) => s.set_read_timeout(Some(limit)),
        }
    }

    /// How long a write may take from now on.
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

/// Listens at a path, also where the socket of a run lies that was killed: nobody listens at it any more.
#[cfg(unix)]
fn bind(path: &Path) -> std::io::Result<UnixListener> {
    use std::io::ErrorKind::{AddrInUse, ConnectionRefused};
    use std::os::unix::fs::FileTypeExt;
    let in_use = match UnixListener::bind(path) {
        Err(e) if e.kind() == AddrInUse => e,
        other => return other,
    };
    let is_socket = std::fs::symlink_metadata(path).is_ok_and(|m| m.file_type().is_socket());
    // Of another type than what listens there, which so does not hear of it.
    match UnixDatagram::unbound()?.connect(path) {
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

/// An address at which a run waits for the other side. What it left in the file system goes with it.
#[derive(Debug)]
pub struct Listener {
    door: Door,
    address: Address,
    /// File, and folder of its own, to be removed.
    left: Option<PathBuf>,
    folder: Option<PathBuf>,
}

/// Pause between two looks at the door.
const GLANCE: Duration = Duration::from_millis(1);

impl Listener {
    /// Waits at an address.
    ///
    /// # Errors
    /// [`Error::System`], such as an address that is in use.
    pub fn at(address: &Address) -> Result<Self> {
        let failed = system("waiting at", address);
        let mut left = None;
        let mut at = address.clone();
        let door = match address {
            #[cfg(unix)]
            Address::Unix(path) => {
                let listener = bind(path).map_err(&failed)?;
                left = Some(path.clone());
                listener.set_nonblocking(true).map_err(&failed)?;
                Door::Unix(listener)
            }
            #[cfg(not(unix))]
            Address::Unix(_) => return Err(failed(std::io::ErrorKind::Unsupported.into())),
            Address::Tcp(socket) => {
                let listener = TcpListener::bind(socket).map_err(&failed)?;
                listener.set_nonblocking(true).map_err(&failed)?;
                at = Address::Tcp(listener.local_addr().map_err(&failed)?);
                Door::Tcp(listener)
            }
        };
        let (address, folder) = (at, None);
        Ok(Self {
            door,
            address,
            left,
            folder,
        })
    }

    /// Waits at an address that nobody else knows: a socket in a new folder that only this user may enter;
    /// a free port of the loopback where there are no such sockets.
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
                match std::fs::DirBuilder::new().mode(0o700).create(&folder) {
                    // Left by a process of the same number that was killed.
                    Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
                    Err(e) => {
                        return Err(Error::System {
                            what: format!("making folder {}", folder.display()),
                            reason: e.to_string(),
                        });
                    }
                    Ok(()) => {
                        let listener = Self::at(&Address::Unix(folder.join("link")));
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
        Self::at(&Address::Tcp(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))))
    }

    /// The address, with the port that was chosen where it was left open.
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// Takes the first who comes, until `until`; `watch` is asked meanwhile whether it is worth waiting.
    pub(crate) fn accept(
        &self,
        until: Instant,
        watch: &mut dyn FnMut() -> Result<()>,
    ) -> Result<Option<Stream>> {
        let failed = system("waiting at", &self.address);
        loop {
            let came = match &self.door {
                #[cfg(unix)]
                Door::Unix(l) => l.accept().and_then(|(s, _)| {
                    s.set_nonblocking(false)?;
                    Ok(Stream::Unix(s))
                }),
                Door::Tcp(l) => l.accept().and_then(|(s, _)| {
                    s.set_nonblocking(false)?;
                    s.set_nodelay(true)?;
                    Ok(Stream::Tcp(s))
                }),
            };
            match came {
                Ok(stream) => return Ok(Some(stream)),
                Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => {}
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
        if let Some(path) = &self.left {
            let _ = std::fs::remove_file(path);
        }
        if let Some(path) = &self.folder {
            let _ = std::fs::remove_dir(path);
        }
    }
}
