//! Apps that want to know what there is in the domain.

use super::sim::{Net, endpoint, prefix};
use super::{READER, SECOND, WRITER};
use crate::layer::protocol::{Discovered, FromLayer, ToLayer};
use crate::wire::Guid;

/// What an app was told, in short.
fn told(net: &mut Net, host: usize, app: u8) -> Vec<String> {
    let replies = net.replies(host).into_iter();
    replies
        .filter_map(|(slot, message)| match message {
            FromLayer::Discovered(discovered) => Some((slot, discovered)),
            _ => None,
        })
        .map(|(slot, discovered)| {
            assert_eq!(slot, app, "others have not asked");
            match discovered {
                Discovered::Begin => "begin".to_owned(),
                Discovered::Participant(data) => format!("participant {}", data.prefix),
                Discovered::ParticipantGone(prefix) => format!("no participant {prefix}"),
                Discovered::Endpoint(endpoint) => format!("endpoint {}", endpoint.guid),
                Discovered::EndpointGone(guid) => format!("no endpoint {guid}"),
                Discovered::More(guid) => format!("more after {guid}"),
                Discovered::Complete => "complete".to_owned(),
            }
        })
        .collect()
}

#[test]
fn who_asks_is_told_what_is_there_and_what_changes() {
    let mut net = Net::new(2);
    let (browser, neighbour, remote) = (net.attach(0), net.attach(0), net.attach(1));
    net.declare(0, endpoint(browser, 1, WRITER));
    let near = net.declare(0, endpoint(neighbour, 1, READER));
    let far = net.declare(1, endpoint(remote, 1, WRITER));
    net.run(SECOND);
    assert!(told(&mut net, 0, browser).is_empty());
    let browse = |net: &mut Net, after: Option<Guid>| {
        net.request(0, browser, ToLayer::Browse { after });
        told(net, 0, browser)
    };
    let last = near.max(far);
    assert_eq!(
        browse(&mut net, None),
        [
            "begin".to_owned(),
            format!("participant {}", prefix(2)),
            format!("endpoint {near}"),
            format!("endpoint {far}"),
            format!("more after {last}"),
        ]
    );
    assert_eq!(browse(&mut net, Some(last)), ["complete"]);

    net.declare(0, endpoint(browser, 2, WRITER));
    let second = net.declare(0, endpoint(neighbour, 2, READER));
    assert_eq!(told(&mut net, 0, browser), [format!("endpoint {second}")]);
    net.request(0, neighbour, ToLayer::Withdraw(second.entity));
    assert_eq!(
        told(&mut net, 0, browser),
        [format!("no endpoint {second}")]
    );
    net.hosts[1].layer.shutdown(net.now);
    net.run(SECOND);
    assert_eq!(
        told(&mut net, 0, browser),
        [
            format!("no endpoint {far}"),
            format!("no participant {}", prefix(2))
        ]
    );
}
