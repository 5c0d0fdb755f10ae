// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <idl/cairn.h>

#include <cstddef>
#include <memory>
#include <vector>

#include "common/base/result.h"
#include "common/image/limits.h"
#include "common/map/limits.h"
#include "common/wire/limits.h"
#include "common/wire/messages.h"
#include "common/wire/rig_messages.h"
#include "common/wire/wearer_messages.h"

/// Between the value types of messages.h and the generated structs. decode() believes nothing: what it lets
/// through has finite numbers of sensible size, unit quaternions and directions, known enumerators, counts
/// within bounds, printable texts, and lists that agree with each other. Pure; thread-safe.
namespace cairn::wire::internal {

// Limits are stated once, in the headers named limits.h and beside the messages; idl/cairn.idl bounds its
// sequences by the same.
static_assert(kMaxTrails == cairn_MAX_TRAILS);
static_assert(kMaxMeasurements == cairn_MAX_MEASUREMENTS);
static_assert(kMaxCandidates == cairn_MAX_CANDIDATES);
static_assert(kMaxPlaceCorners == cairn_MAX_PLACE_CORNERS);
static_assert(kMaxPlaceCandidates == cairn_MAX_PLACE_CANDIDATES);
static_assert(kMaxCameraValues == cairn_MAX_CAMERA_VALUES);
static_assert(kMaxCalibratedCameras == cairn_MAX_CALIBRATED_CAMERAS);
static_assert(kBlockSlots == cairn_BLOCK_SLOTS);
static_assert(kMaxBlocks == cairn_MAX_BLOCKS);
static_assert(kMaxKeyframeBlocks == cairn_MAX_KEYFRAME_BLOCKS);
static_assert(kMaxOutcomes == cairn_MAX_OUTCOMES);
static_assert(kMaxFurtherDirections == cairn_MAX_FURTHER_DIRECTIONS);
static_assert(kMaxRigSamples == cairn_MAX_RIG_SAMPLES);

/// Memory for the array elements of one encoded sample; keeps it while the sample is written.
class Scratch {
 public:
  template <typename T>
  T* array(size_t count) {
    arrays_.push_back(
        std::make_unique<std::byte[]>(count * sizeof(T)));  // new is aligned for every generated struct
    return reinterpret_cast<T*>(arrays_.back().get());
  }

 private:
  std::vector<std::unique_ptr<std::byte[]>> arrays_;
};

/// Generated struct of a message type: `DdsType<MapInfo>` is cairn_MapInfo.
template <typename Message>
struct DdsTypeOf;
template <typename Message>
using DdsType = typename DdsTypeOf<Message>::type;

/// The sample to write. It borrows from `message` and `scratch`, and goes with the shorter-lived of them.
/// Never freed as a sample.
template <typename Message>
[[nodiscard]] DdsType<Message> encode(const Message& message, Scratch* scratch);
/// A copy as value, or why the sample is unfit (for the log).
template <typename Message>
[[nodiscard]] Result<Message> decode(const DdsType<Message>& sample);
/// The key members only; of an invalid sample (dispose) no others are set.
template <typename Message>
[[nodiscard]] Message decode_key(const DdsType<Message>& sample);
/// Size of the content, within a few per cent of what is serialized.
template <typename Message>
[[nodiscard]] size_t payload_bytes(const DdsType<Message>& sample);

#define CAIRN_WIRE_MESSAGES(X)               \
  X(CameraMessage, cairn_Camera)             \
  X(MapSeed, cairn_MapSeed)                  \
  X(KeyframeOffer, cairn_KeyframeOffer)      \
  X(TrackerStateMessage, cairn_TrackerState) \
  X(ServerStatus, cairn_ServerStatus)        \
  X(MapInfo, cairn_MapInfo)                  \
  X(PointPatches, cairn_PointPatches)        \
  X(PointPositions, cairn_PointPositions)    \
  X(KeyframePoses, cairn_KeyframePoses)      \
  X(MapCommit, cairn_MapCommit)              \
  X(SeedVerdict, cairn_SeedVerdict)          \
  X(OfferVerdict, cairn_OfferVerdict)        \
  X(RelocQuery, cairn_RelocQuery)            \
  X(RelocAnswer, cairn_RelocAnswer)          \
  X(CameraEstimate, cairn_CameraEstimate)    \
  X(ClientRequest, cairn_ClientRequest)      \
  X(ClientReply, cairn_ClientReply)          \
  X(LabelMessage, cairn_Label)               \
  X(AdminRequest, cairn_AdminRequest)        \
  X(AdminReply, cairn_AdminReply)            \
  X(RigCommand, cairn_RigCommand)            \
  X(RigState, cairn_RigState)                \
  X(WearerCamera, cairn_WearerCamera)        \
  X(PictureRequest, cairn_PictureRequest)    \
  X(CameraPicture, cairn_CameraPicture)

// A specialization is declared before any file uses it, as files can be compiled as one.
#define CAIRN_WIRE_DDS_TYPE(Message, Dds)        \
  template <>                                    \
  struct DdsTypeOf<Message> {                    \
    using type = Dds;                            \
  };                                             \
  template <>                                    \
  Dds encode<Message>(const Message&, Scratch*); \
  template <>                                    \
  Result<Message> decode<Message>(const Dds&);   \
  template <>                                    \
  Message decode_key<Message>(const Dds&);       \
  template <>                                    \
  size_t payload_bytes<Message>(const Dds&);
CAIRN_WIRE_MESSAGES(CAIRN_WIRE_DDS_TYPE)
#undef CAIRN_WIRE_DDS_TYPE

}  // namespace cairn::wire::internal
