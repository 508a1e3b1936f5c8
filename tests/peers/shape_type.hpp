// ShapeType (see ShapeType.idl) for Fast DDS 2.9. Debian has no fastddsgen, so the type support
// that it would generate is written by hand.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <fastdds/dds/topic/TopicDataType.hpp>

struct ShapeType {
    std::string color;
    int32_t x = 0;
    int32_t y = 0;
    int32_t shapesize = 0;
    std::vector<uint8_t> additional_payload_size;
};

// Writes plain CDR, little endian, and reads it in either byte order (XTypes 1.3, 7.6.2.1.2).
class ShapeTypeSupport : public eprosima::fastdds::dds::TopicDataType {
public:
    explicit ShapeTypeSupport(uint32_t additional_payload);

    bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override;
    bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override;
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override;
    void* createData() override;
    void deleteData(void* data) override;
    bool getKey(void* data, eprosima::fastrtps::rtps::InstanceHandle_t* handle,
                bool force_md5) override;
};
