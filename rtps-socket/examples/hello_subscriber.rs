//! Prints greetings until none has come for a minute.
use rtps_socket::{DdsType, DomainParticipant, Qos};
#[derive(DdsType)]
struct Greeting {
    text: String,
}
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let participant = DomainParticipant::new(0)?;
    let topic = participant.create_topic::<Greeting>("Greetings")?;
    let reader = participant.create_reader(&topic, Qos::reliable())?;
    while let Some(sample) = reader.take_next(std::time::Duration::from_secs(60)) {
        println!("{:?}", sample.data.map(|greeting| greeting.text));
    }
    Ok(())
}
