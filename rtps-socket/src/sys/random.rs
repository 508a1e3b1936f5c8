//! Random bytes from the kernel: for GUID prefixes.

use std::io;

use super::check_len;

/// `N` random bytes.
pub(crate) fn random_bytes<const N: usize>() -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    // SAFETY: `bytes` is writable for its length; requests of up to 256 bytes are filled whole.
    let len = check_len(unsafe { libc::getrandom(bytes.as_mut_ptr().cast(), N, 0) })?;
    match len == N {
        true => Ok(bytes),
        false => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}
