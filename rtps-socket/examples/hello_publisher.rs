//! Writes one greeting as soon as somebody listens.
use rtps_socket::{DdsType, DomainParticipant, Qos};
#[derive(DdsType)]
struct Greeting {
    text: String,
}
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let participant = DomainParticipant::new(0)?;
    let topic = participant.create_topic("Greetings")?;
    let writer = participant.create_writer(&topic, Qos::reliable())?;
    writer.wait_for_matched(1, std::time::Duration::from_secs(60))?;
    let text = "Hello from Rust".to_owned();
    writer.write(&Greeting { text })?;
    Ok(writer.wait_for_acknowledgments(std::time::Duration::from_secs(5))?)
}
