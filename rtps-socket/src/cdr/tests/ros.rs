//! Messages of ROS 2, which are final types in XCDR1, without keys and under names that its IDL generator makes.

use super::{hex, payload_of};
use crate::DdsType;
use crate::cdr::{DdsType, Representation, TypeSupport, from_payload};

#[derive(Debug, PartialEq, DdsType)]
#[dds(final, by_name, type_name = "std_msgs::msg::dds_::String_")]
struct StringMessage {
    data: String,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final, type_name = "builtin_interfaces::msg::dds_::Time_")]
struct Time {
    sec: i32,
    nanosec: u32,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final, type_name = "std_msgs::msg::dds_::Header_")]
struct Header {
    stamp: Time,
    frame_id: String,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final, by_name, type_name = "sensor_msgs::msg::dds_::Image_")]
struct Image {
    header: Header,
    height: u32,
    width: u32,
    encoding: String,
    is_bigendian: u8,
    step: u32,
    data: Vec<u8>,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final, type_name = "geometry_msgs::msg::dds_::Point_")]
struct Point {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final, type_name = "geometry_msgs::msg::dds_::Quaternion_")]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final, type_name = "geometry_msgs::msg::dds_::Pose_")]
struct Pose {
    position: Point,
    orientation: Quaternion,
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(final, type_name = "geometry_msgs::msg::dds_::PoseWithCovariance_")]
struct PoseWithCovariance {
    pose: Pose,
    covariance: [f64; 36],
}

#[derive(Debug, PartialEq, DdsType)]
#[dds(
    final,
    by_name,
    type_name = "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_"
)]
struct PoseWithCovarianceStamped {
    header: Header,
    pose: PoseWithCovariance,
}

#[track_caller]
fn assert_message<T: DdsType + PartialEq + std::fmt::Debug>(
    value: &T,
    type_name: &str,
    expected: &[u8],
) {
    assert_eq!(T::TYPE_NAME, type_name);
    const { assert!(!T::HAS_KEY) };
    assert_eq!(T::type_support(), TypeSupport::default());
    assert_eq!(payload_of(value, Representation::Xcdr1), expected);
    // ROS 2 neither pads at the end nor counts padding.
    let padding = usize::from(expected[3]);
    let mut sent = expected[..expected.len() - padding].to_vec();
    sent[3] = 0;
    assert_eq!(from_payload(&sent).as_ref(), Ok(value));
}

fn header() -> Header {
    Header {
        stamp: Time {
            sec: 1,
            nanosec: 500_000_000,
        },
        frame_id: "map".to_owned(),
    }
}

const HEADER: &str = "01000000 0065cd1d 04000000 6d617000";

#[test]
fn a_string() {
    let message = StringMessage {
        data: "Hello World: 1".to_owned(),
    };
    let expected = hex("00010001 0f000000 48656c6c 6f20576f 726c643a 203100 00");
    assert_message(&message, "std_msgs::msg::dds_::String_", &expected);
}

#[test]
fn an_image() {
    let message = Image {
        header: header(),
        height: 1,
        width: 2,
        encoding: "rgb8".to_owned(),
        is_bigendian: 0,
        step: 6,
        data: vec![1, 2, 3, 4, 5, 6],
    };
    let expected = [
        hex("00010002"),
        hex(HEADER),
        hex("01000000 02000000 05000000 72676238 00 00 0000 06000000 06000000 01020304 0506 0000"),
    ];
    assert_message(
        &message,
        "sensor_msgs::msg::dds_::Image_",
        &expected.concat(),
    );
}

#[test]
fn a_pose_in_messages_in_messages() {
    let covariance: [f64; 36] = std::array::from_fn(|at| at as f64);
    let message = PoseWithCovarianceStamped {
        header: header(),
        pose: PoseWithCovariance {
            pose: Pose {
                position: Point {
                    x: 1.0,
                    y: 2.0,
                    z: 3.0,
                },
                orientation: Quaternion {
                    x: 0.0,
                    y: 0.0,
                    z: 0.0,
                    w: 1.0,
                },
            },
            covariance,
        },
    };
    let numbers = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0];
    let numbers = numbers.into_iter().chain(covariance);
    let expected = [
        hex("00010000"),
        hex(HEADER),
        numbers.flat_map(f64::to_le_bytes).collect(),
    ];
    assert_message(
        &message,
        "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
        &expected.concat(),
    );
}
