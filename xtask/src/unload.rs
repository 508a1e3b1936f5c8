//! `cargo xtask unload`: ends rtpsd and removes all that the layer has in the kernel and in the file system.

use anyhow::Result;

/// Unloads, and says what there was.
pub(crate) fn run() -> Result<()> {
    let unloaded = rtpsd::unload()?;
    match unloaded.rtpsd {
        Some(pid) if unloaded.killed => {
            println!("rtpsd (pid {pid}) did not end by itself and was killed")
        }
        Some(pid) => println!("rtpsd (pid {pid}) ended"),
        None => println!("no rtpsd was running"),
    }
    if unloaded.leftovers {
        println!("what it had left pinned or attached was removed");
    }
    Ok(())
}
