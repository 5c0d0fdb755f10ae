// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/convert.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <set>

#include "common/image/still_mask.h"
#include "common/wire/internal/configuration.h"
#include "common/wire/test_messages.h"

namespace cairn::wire {
namespace {

using internal::DdsType;
using internal::decode;
using internal::encode;
using internal::Scratch;
using testing::RandomMessages;

constexpr unsigned kSeed = 5;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr Timestamp kNoTime{kMaxTime};
constexpr float kInfinity = std::numeric_limits<float>::infinity();

template <typename Message>
class RoundTrip : public ::testing::Test {};
using AllMessages = ::testing::Types<CameraMessage, MapSeed, KeyframeOffer, TrackerStateMessage, ServerStatus,
                                     MapInfo, PointPatches, PointPositions, KeyframePoses, MapCommit,
                                     SeedVerdict, OfferVerdict, RelocQuery, RelocAnswer, CameraEstimate,
                                     ClientRequest, ClientReply, LabelMessage, AdminRequest, AdminReply,
                                     RigCommand, RigState, WearerCamera, PictureRequest, CameraPicture>;
TYPED_TEST_SUITE(RoundTrip, AllMessages);

TYPED_TEST(RoundTrip, KeepsEveryMember) {
  RandomMessages random(kSeed);
  for (int i = 0; i < 50; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", message " << i);
    const auto message = random.make<TypeParam>();
    Scratch scratch;
    const auto decoded = decode<TypeParam>(encode(message, &scratch));
    ASSERT_TRUE(decoded.has_value()) << decoded.error().message;
    EXPECT_TRUE(testing::same(message, *decoded));
    EXPECT_FALSE(testing::same(message, random.make<TypeParam>())) << "the comparison sees nothing";
  }
}

TYPED_TEST(RoundTrip, RefusesAnUnknownSchema) {
  RandomMessages random(kSeed);
  const auto message = random.make<TypeParam>();
  Scratch scratch;
  auto sample = encode(message, &scratch);
  sample.schema_version = 0;
  EXPECT_FALSE(decode<TypeParam>(sample).has_value());
  sample.schema_version = 7;
  EXPECT_TRUE(decode<TypeParam>(sample).has_value()) << "a newer writer only appends";
}

/// The least number that is no enumerator.
template <BoundedEnum Enum>
constexpr Enum beyond() {
  return static_cast<Enum>(kEnumerators<Enum>);
}

/// A round trip says nothing of an enumerator that is never drawn.
TEST(RandomMessages, HaveEveryEnumerator) {
  RandomMessages random(kSeed);
  std::set<OfferDecision> decisions;
  std::set<RequestDecision> requests;
  std::set<RigMode> modes;
  std::set<CameraModel> models;
  for (int i = 0; i < 500; ++i) {
    for (const OfferOutcome& outcome : random.make<OfferVerdict>().recent) decisions.insert(outcome.decision);
    for (const RequestOutcome& outcome : random.make<ClientReply>().recent) requests.insert(outcome.decision);
    modes.insert(random.make<RigCommand>().mode);
    models.insert(random.make<CameraMessage>().parameters.model);
  }
  EXPECT_EQ(decisions.size(), kEnumerators<OfferDecision>);
  EXPECT_EQ(requests.size(), kEnumerators<RequestDecision>);
  EXPECT_EQ(modes.size(), kEnumerators<RigMode>);
  EXPECT_EQ(models.size(), camera_models().size());
}

/// Spoils a valid message in one way at a time.
template <typename Message>
class Spoiler {
 public:
  explicit Spoiler(std::function<bool(const Message&)> usable = [](const Message&) { return true; }) {
    RandomMessages random(kSeed);
    do {
      good_ = random.make<Message>();
    } while (!usable(good_));
  }
  void refuses(const char* what, const std::function<void(Message&)>& spoil) const {
    Message bad = good_;
    spoil(bad);
    Scratch scratch;
    const auto decoded = decode<Message>(encode(bad, &scratch));
    EXPECT_FALSE(decoded.has_value()) << what;
    if (!decoded) {
      EXPECT_EQ(decoded.error().code, ErrorCode::kDamaged);
    }
  }

 private:
  Message good_;
};

void refuse_bad_images(
    const std::function<void(const char*, const std::function<void(ImageMessage&)>&)>& refuses) {
  refuses("no width", [](ImageMessage& m) { m.width = 0; });
  refuses("too wide", [](ImageMessage& m) {
    m.width = kMaxImageSide + 1;
    m.encoding = ImageEncoding::kJpeg;
  });
  refuses("width times height beyond 32 bits", [](ImageMessage& m) { m.width = m.height = 65536; });
  refuses("raw, too short", [](ImageMessage& m) {
    m.encoding = ImageEncoding::kRaw;
    m.bytes.resize(size_t{m.width} * m.height - 1);
  });
  refuses("raw, too long", [](ImageMessage& m) {
    m.encoding = ImageEncoding::kRaw;
    m.bytes.resize(size_t{m.width} * m.height + 1);
  });
  refuses("empty jpeg", [](ImageMessage& m) {
    m.encoding = ImageEncoding::kJpeg;
    m.bytes.clear();
  });
  refuses("unknown encoding", [](ImageMessage& m) { m.encoding = beyond<ImageEncoding>(); });
}

template <typename Message>
void refuse_bad_cameras() {
  const Spoiler<Message> camera([](const auto& m) { return !m.sigma.empty(); });
  camera.refuses("unknown model", [](auto& m) { m.parameters.model = static_cast<CameraModel>(200); });
  camera.refuses("no width", [](auto& m) { m.parameters.width = 0; });
  camera.refuses("negative height", [](auto& m) { m.parameters.height = -1; });
  camera.refuses("NaN", [](auto& m) { m.parameters.values[3] = kNan; });
  camera.refuses("infinity", [](auto& m) { m.parameters.values[3] = -kInfinity; });
  camera.refuses("too many values", [](auto& m) {
    m.parameters.values.resize(33);
    m.sigma.resize(33);
  });
  camera.refuses("sigma of another length", [](auto& m) { m.sigma.pop_back(); });
  camera.refuses("negative sigma", [](auto& m) { m.sigma[0] = -1; });
}

TEST(Validation, Camera) {
  refuse_bad_cameras<CameraMessage>();
}

TEST(Validation, CameraEstimate) {
  refuse_bad_cameras<CameraEstimate>();
}

/// What is no direction of up, as a member of a message.
template <typename Message>
void refuse_bad_ups(const Spoiler<Message>& spoiler, std::optional<UpDirection> Message::*up) {
  const Eigen::Vector3d sound = Eigen::Vector3d::UnitX();
  for (const auto& [what, wrong] : {std::pair("up of no length", UpDirection{{0, 0, 0}, 0.1}),
                                    std::pair("up too long", UpDirection{{0, 0, 1.01}, 0.1}),
                                    std::pair("up is NaN", UpDirection{{kNan, 0, 1}, 0.1}),
                                    std::pair("infinite up", UpDirection{{0, kInfinity, 0}, 0.1}),
                                    std::pair("negative sigma", UpDirection{sound, -0.1}),
                                    std::pair("sigma is NaN", UpDirection{sound, kNan}),
                                    std::pair("sigma that says nothing", UpDirection{sound, 1.5})})
    spoiler.refuses(what, [up, wrong = wrong](auto& m) { m.*up = wrong; });
}

TEST(Validation, MapSeed) {
  const Spoiler<MapSeed> seed([](const auto& m) { return !m.trails.empty(); });
  refuse_bad_ups(seed, &MapSeed::second_up);
  refuse_bad_images([&](const char* what, const auto& spoil) {
    seed.refuses(what, [&](auto& m) { spoil(m.first_image); });
    seed.refuses(what, [&](auto& m) { spoil(m.second_image); });
  });
  seed.refuses("images of unequal size", [](auto& m) {
    m.first_image = {ImageEncoding::kRaw, 2, 3, std::vector<uint8_t>(6)};
    m.second_image = {ImageEncoding::kRaw, 3, 2, std::vector<uint8_t>(6)};
  });
  seed.refuses("no session", [](auto& m) { m.command.session = {}; });
  seed.refuses("no number", [](auto& m) { m.command.seq = 0; });
  seed.refuses("NaN pixel", [](auto& m) { m.trails.back().second.y() = kNan; });
  seed.refuses("far pixel", [](auto& m) { m.trails.back().first.x() = 1e9F; });
  seed.refuses("too many trails", [](auto& m) { m.trails.resize(kMaxTrails + 1, m.trails[0]); });
  seed.refuses("name with a control character", [](auto& m) { m.map_name = std::string("desk\x1b[2J"); });
  seed.refuses("name that is no UTF-8", [](auto& m) { m.map_name = std::string("K\xfc"); });
  seed.refuses("name too long", [](auto& m) { m.map_name.assign(kMaxNameBytes + 1, 'x'); });
  seed.refuses("time of no clock", [](auto& m) { m.second_time = kNoTime; });
  seed.refuses("mask of another image", [](auto& m) { m.still_mask.assign(20000, 0); });
}

TEST(Validation, KeyframeOffer) {
  const Spoiler<KeyframeOffer> offer([](const auto& m) {
    return !m.measurements.empty() && !m.candidates.empty() && m.still_mask.size() > 1;
  });
  refuse_bad_ups(offer, &KeyframeOffer::up);
  refuse_bad_images(
      [&](const char* what, const auto& spoil) { offer.refuses(what, [&](auto& m) { spoil(m.image); }); });
  offer.refuses("no number", [](auto& m) { m.command.seq = 0; });
  offer.refuses("NaN translation", [](auto& m) {
    m.camera_from_reference = SE3(Eigen::Quaterniond::Identity(), {0, kNan, 0});
  });
  offer.refuses("unknown level", [](auto& m) { m.measurements[0].level = 4; });
  offer.refuses("infinite pixel", [](auto& m) { m.measurements[0].pixel.x() = kInfinity; });
  offer.refuses("too many measurements",
                [](auto& m) { m.measurements.resize(kMaxMeasurements + 1, m.measurements[0]); });
  offer.refuses("too many candidates",
                [](auto& m) { m.candidates.resize(kMaxCandidates + 1, m.candidates[0]); });
  offer.refuses("unknown level of a candidate", [](auto& m) { m.candidates[0].level = kPyramidLevels; });
  offer.refuses("NaN pixel of a candidate", [](auto& m) { m.candidates[0].pixel.y() = kNan; });
  offer.refuses("infinite inverse depth", [](auto& m) { m.candidates[0].inverse_depth = kInfinity; });
  offer.refuses("behind the camera", [](auto& m) { m.candidates[0].inverse_depth = -0.5F; });
  offer.refuses("no depth", [](auto& m) { m.candidates[0].inverse_depth = 0; });
  offer.refuses("NaN sigma", [](auto& m) { m.candidates[0].sigma = kNan; });
  offer.refuses("no sigma", [](auto& m) { m.candidates[0].sigma = 0; });
  offer.refuses("time of no clock", [](auto& m) { m.time = kNoTime; });
  offer.refuses("refers to itself", [](auto& m) { m.reference_command = m.command.seq; });
  offer.refuses("mask too short", [](auto& m) { m.still_mask.pop_back(); });
  offer.refuses("mask too long", [](auto& m) { m.still_mask.push_back(0); });
}

TEST(Validation, Quaternions) {
  RandomMessages random(kSeed);
  const auto message = random.make<TrackerStateMessage>();
  Scratch scratch;
  auto sample = encode(message, &scratch);
  for (double& value : sample.camera_from_map.rotation) value *= 1.01;
  EXPECT_FALSE(decode<TrackerStateMessage>(sample).has_value()) << "not of unit length";
  for (double& value : sample.camera_from_map.rotation) value = 0;
  EXPECT_FALSE(decode<TrackerStateMessage>(sample).has_value()) << "zero";
  sample.camera_from_map.rotation[3] = kNan;
  EXPECT_FALSE(decode<TrackerStateMessage>(sample).has_value()) << "NaN";
}

TEST(Validation, TrackerState) {
  const Spoiler<TrackerStateMessage> state;
  state.refuses("unknown state", [](auto& m) { m.state = beyond<TrackingState>(); });
  state.refuses("no session", [](auto& m) { m.session = {}; });
  state.refuses("NaN quality", [](auto& m) { m.quality = kNan; });
  state.refuses("quality above one", [](auto& m) { m.quality = 1.5F; });
  state.refuses("time of no clock", [](auto& m) { m.frame_time = kNoTime; });
  state.refuses("no name of a wearer", [](auto& m) { m.wearer = "Anna B."; });
  state.refuses("far away", [](auto& m) {
    m.camera_from_map = SE3(Eigen::Quaterniond::Identity(), {1e7, 0, 0});
  });
}

TEST(Validation, ServerStatusAndMapInfo) {
  const Spoiler<ServerStatus> status;
  status.refuses("NaN load", [](auto& m) { m.load = kNan; });
  status.refuses("control character", [](auto& m) { m.health = std::string("a\nb"); });
  const Spoiler<MapInfo> info;
  info.refuses("unknown right", [](auto& m) { m.right = beyond<MapRight>(); });
  info.refuses("bounds upside down", [](auto& m) { std::swap(m.bounds_min, m.bounds_max); });
  info.refuses("NaN bounds", [](auto& m) { m.bounds_max.z() = kNan; });
  info.refuses("name too long", [](auto& m) { m.name.assign(kMaxNameBytes + 1, 'x'); });
}

TEST(Validation, RigCommand) {
  const Spoiler<RigCommand> command;
  command.refuses("no rig", [](auto& m) { m.rig.clear(); });
  command.refuses("every rig", [](auto& m) { m.rig = "*"; });
  command.refuses("no commander", [](auto& m) { m.commander.clear(); });
  command.refuses("commander of another form", [](auto& m) { m.commander = "Anna B."; });
  command.refuses("no session", [](auto& m) { m.order.session = {}; });
  command.refuses("no number", [](auto& m) { m.order.seq = 0; });
  command.refuses("unknown mode", [](auto& m) { m.mode = beyond<RigMode>(); });
  command.refuses("NaN target", [](auto& m) { m.target.y() = kNan; });
  command.refuses("far target", [](auto& m) { m.target.x() = 1e7; });
  command.refuses("NaN angle", [](auto& m) { m.angles[0] = kNan; });
  command.refuses("many turns", [](auto& m) { m.angles[1] = 1e3; });
  command.refuses("infinite rate", [](auto& m) { m.rates[1] = -kInfinity; });
  command.refuses("unknown pattern", [](auto& m) { m.pattern = beyond<RigSearchPattern>(); });
  command.refuses("too many directions", [](auto& m) { m.further.assign(8, Eigen::Vector3d::UnitX()); });
  command.refuses("NaN direction", [](auto& m) { m.further.assign(2, {1, kNan, 0}); });
}

TEST(RigMode, EveryOneHasAWord) {
  for (uint8_t mode = 0; mode <= static_cast<uint8_t>(RigMode::kLast); ++mode)
    EXPECT_EQ(parse_rig_mode(name_of(static_cast<RigMode>(mode))), static_cast<RigMode>(mode));
  EXPECT_EQ(parse_rig_mode("unknown"), std::nullopt);
}

TEST(Validation, RigState) {
  const Spoiler<RigState> state;
  state.refuses("no rig", [](auto& m) { m.rig.clear(); });
  state.refuses("unknown mode", [](auto& m) { m.mode = beyond<RigMode>(); });
  state.refuses("unknown condition", [](auto& m) { m.axes[1].condition = beyond<RigAxisCondition>(); });
  state.refuses("unknown fault", [](auto& m) { m.axes[0].fault = 64; });
  state.refuses("NaN position", [](auto& m) { m.axes[0].position = kNan; });
  state.refuses("infinite rate", [](auto& m) { m.axes[1].rate = kInfinity; });
  state.refuses("NaN rate of turn", [](auto& m) { m.imu.rate.z() = static_cast<float>(kNan); });
  state.refuses("acceleration of a shot", [](auto& m) { m.imu.acceleration.x() = 1e4F; });
  state.refuses("no attitude", [](auto& m) { m.imu.world_from_head.coeffs().setZero(); });
  state.refuses("more than all", [](auto& m) { m.looked_at = 1.5F; });
  state.refuses("offset of no clock", [](auto& m) { m.camera_clock.offset = kNoTime.nanoseconds; });
  state.refuses("NaN deviation", [](auto& m) { m.camera_clock.sigma = static_cast<float>(kNan); });
  state.refuses("order of every commander", [](auto& m) { m.ordered_by = "*"; });
  state.refuses("order of no mode", [](auto& m) { m.ordered = beyond<RigMode>(); });
  state.refuses("time of no clock", [](auto& m) { m.time = kNoTime; });
  state.refuses("samples of no clock", [](auto& m) { m.imu.time = kNoTime; });
  state.refuses("control character", [](auto& m) { m.trouble = "a\nb"; });
  const Spoiler<RigState> sensing(
      [](const auto& m) { return m.samples.size() > 2 && m.camera_from_imu && m.base_from_camera; });
  sensing.refuses("more samples than a packet has", [](auto& m) {
    m.samples.resize(kMaxRigSamples + 1);
    for (size_t i = 0; i < m.samples.size(); ++i) m.samples[i].time = {static_cast<int64_t>(i)};
  });
  sensing.refuses("samples out of order", [](auto& m) { std::swap(m.samples[0], m.samples[1]); });
  sensing.refuses("NaN turn", [](auto& m) { m.samples[1].rate.x() = static_cast<float>(kNan); });
  sensing.refuses("pull of a shot", [](auto& m) { m.samples[2].acceleration.y() = 1e4F; });
  sensing.refuses("sample of no clock", [](auto& m) { m.samples.back().time = kNoTime; });
  sensing.refuses("no mount", [](auto& m) { m.camera_from_imu->coeffs().setZero(); });
  sensing.refuses("no aim", [](auto& m) { m.base_from_camera->coeffs().setConstant(kNan); });
  sensing.refuses("calibrated to no clock", [](auto& m) { m.calibrated_offset = kNoTime.nanoseconds; });
  state.refuses("more than a packet", [](auto& m) { m.refusal.assign(kMaxRigText + 1, 'x'); });
}

TEST(Validation, PointPatches) {
  const Spoiler<PointPatches> patches([](const auto& m) { return m.block.points.size() > 2; });
  patches.refuses("block index", [](auto& m) { m.block.index = kMaxBlocks; });
  patches.refuses("too many points", [](auto& m) {
    while (m.block.points.size() < 65) {
      m.block.points.push_back(m.block.points.back());
      ++m.block.points.back().id.value;
    }
  });
  patches.refuses("ids out of order", [](auto& m) { std::swap(m.block.points[0].id, m.block.points[1].id); });
  patches.refuses("id twice", [](auto& m) { m.block.points[1].id = m.block.points[0].id; });
  patches.refuses("no id", [](auto& m) { m.block.points[0].id = {}; });
  patches.refuses("level", [](auto& m) { m.block.points[0].level = 4; });
  patches.refuses("corner", [](auto& m) { m.block.points[0].corner.x = -1; });
  patches.refuses("ray", [](auto& m) { m.block.points[0].ray_center *= 1.1F; });
  patches.refuses("NaN ray", [](auto& m) { m.block.points[0].ray_down.x() = kNan; });
  patches.refuses("no normal", [](auto& m) { m.block.points[0].normal.setZero(); });
}

TEST(Validation, PointPositions) {
  const Spoiler<PointPositions> positions(
      [](const auto& m) { return m.block.positions.size() > 2 && m.block.positions.size() < 64; });
  positions.refuses("block index", [](auto& m) { m.block.index = ~0U; });
  positions.refuses("NaN", [](auto& m) { m.block.positions[1].y() = kNan; });
  positions.refuses("far away", [](auto& m) { m.block.positions[1].y() = -1e7F; });
  positions.refuses("live bit without slot",
                    [](auto& m) { m.block.live |= uint64_t{1} << m.block.positions.size(); });
  positions.refuses("direction", [](auto& m) { m.block.visibility[0].mean_direction = {0, 0, 0.5F}; });
  positions.refuses("cosine", [](auto& m) { m.block.visibility[0].min_cosine = -1.5F; });
  positions.refuses("distance", [](auto& m) { m.block.visibility[0].max_distance = kInfinity; });
  positions.refuses("negative distance", [](auto& m) { m.block.visibility[0].min_distance = -1; });
  positions.refuses("too many points", [](auto& m) {
    m.block.positions.resize(65, m.block.positions[0]);
    m.block.visibility.resize(65, m.block.visibility[0]);
  });
}

TEST(Validation, KeyframePoses) {
  const Spoiler<KeyframePoses> poses(
      [](const auto& m) { return m.block.keyframes.size() > 2 && m.block.keyframes.size() < 64; });
  poses.refuses("block index", [](auto& m) { m.block.index = kMaxKeyframeBlocks; });
  poses.refuses("ids out of order",
                [](auto& m) { std::swap(m.block.keyframes[0].id, m.block.keyframes[1].id); });
  poses.refuses("infinite", [](auto& m) {
    m.block.keyframes[0].camera_from_map = SE3(Eigen::Quaterniond::Identity(), {kInfinity, 0, 0});
  });
  poses.refuses("depth", [](auto& m) { m.block.keyframes[0].mean_depth = -1; });
  poses.refuses("live bit without slot", [](auto& m) { m.block.live |= uint64_t{1} << 63; });
}

TEST(Validation, MapCommit) {
  const Spoiler<MapCommit> commit([](const auto& m) { return m.points.size() > 2; });
  commit.refuses("block left out", [](auto& m) { m.points.erase(m.points.begin()); });
  commit.refuses("block twice", [](auto& m) { m.points[1].index = 0; });
  commit.refuses("too many blocks", [](auto& m) {
    while (m.points.size() <= kMaxBlocks) m.points.push_back({static_cast<uint32_t>(m.points.size()), 1, 1});
  });
  commit.refuses("too many keyframe blocks",
                 [](auto& m) { m.keyframe_versions.resize(kMaxKeyframeBlocks + 1); });
}

TEST(Validation, Verdicts) {
  const Spoiler<SeedVerdict> seed([](const auto& m) { return !m.points.empty(); });
  seed.refuses("too many points", [](auto& m) { m.points.resize(kMaxTrails + 1, m.points[0]); });
  seed.refuses("control character", [](auto& m) { m.reason = std::string("\r"); });
  const Spoiler<OfferVerdict> offer([](const auto& m) { return !m.recent.empty(); });
  offer.refuses("unknown decision", [](auto& m) { m.recent[0].decision = beyond<OfferDecision>(); });
  offer.refuses("too many outcomes", [](auto& m) { m.recent.resize(kMaxOutcomes + 1, m.recent[0]); });
  offer.refuses("reason too long", [](auto& m) { m.recent[0].reason.assign(kMaxReasonBytes + 1, 'x'); });
}

TEST(Validation, RelocQuery) {
  const Spoiler<RelocQuery> query([](const auto& m) { return !m.corners.empty(); });
  refuse_bad_ups(query, &RelocQuery::up);
  query.refuses("too many corners", [](auto& m) { m.corners.resize(kMaxPlaceCorners + 1, m.corners[0]); });
  query.refuses("unknown level", [](auto& m) { m.corners[0].level = kPyramidLevels; });
  query.refuses("not a number", [](auto& m) { m.corners[0].pixel.x() = kNan; });
  query.refuses("no session", [](auto& m) { m.command.session = {}; });
  query.refuses("an encoded image", [](auto& m) { m.small_image.encoding = ImageEncoding::kJpeg; });
  query.refuses("time of no clock", [](auto& m) { m.time = kNoTime; });
  query.refuses("a whole image", [](auto& m) {
    m.small_image = {ImageEncoding::kRaw, 640, 480, std::vector<uint8_t>(size_t{640} * 480)};
  });
}

TEST(Validation, RelocAnswer) {
  const Spoiler<RelocAnswer> answer;
  answer.refuses("unknown verdict", [](auto& m) { m.answer.verdict = beyond<RelocalizationVerdict>(); });
  answer.refuses("a place without a candidate", [](auto& m) {
    m.answer.verdict = RelocalizationVerdict::kConfirmed;
    m.answer.candidates.clear();
  });
  answer.refuses("too many candidates", [](auto& m) {
    m.answer.candidates.resize(kMaxPlaceCandidates + 1, m.answer.candidates[0]);
  });
  answer.refuses("infinite score", [](auto& m) { m.answer.candidates[0].score = kInfinity; });
  answer.refuses("control character", [](auto& m) { m.answer.candidates[0].reason = std::string("\r"); });
  answer.refuses("a negative count", [](auto& m) { m.answer.candidates[0].inliers = -1; });
}

TEST(Validation, ClientRequest) {
  const Spoiler<ClientRequest> request;
  request.refuses("unknown action", [](auto& m) { m.action = beyond<RequestAction>(); });
  request.refuses("unknown kind", [](auto& m) { m.kind = beyond<LabelKind>(); });
  request.refuses("no number", [](auto& m) { m.command.seq = 0; });
  request.refuses("text too long", [](auto& m) { m.text.assign(kMaxLabelBytes + 1, 'x'); });
  for (const char* text : {"a\x1b[2J", "K\xfc", "a\u202eb", "a\xc2\x9b", "a\u200bb"})
    request.refuses("text that cannot be shown", [text](auto& m) { m.text = std::string(text); });
  request.refuses("not a number", [](auto& m) {
    m.reference_from_label = SE3(Eigen::Quaterniond::Identity(), {kNan, 0, 0});
  });
}

TEST(Validation, ClientReply) {
  const Spoiler<ClientReply> reply([](const auto& m) { return !m.recent.empty(); });
  reply.refuses("unknown decision", [](auto& m) { m.recent[0].decision = beyond<RequestDecision>(); });
  reply.refuses("too many outcomes", [](auto& m) { m.recent.resize(kMaxOutcomes + 1, m.recent[0]); });
  reply.refuses("reason too long", [](auto& m) { m.recent[0].reason.assign(kMaxReasonBytes + 1, 'x'); });
}

TEST(Validation, Label) {
  const Spoiler<LabelMessage> label;
  label.refuses("none", [](auto& m) { m.label.id = {}; });
  label.refuses("unknown kind", [](auto& m) { m.label.kind = beyond<LabelKind>(); });
  label.refuses("text too long", [](auto& m) { m.label.text.assign(kMaxLabelBytes + 1, 'x'); });
  label.refuses("control character", [](auto& m) { m.label.author = std::string("\n"); });
  label.refuses("text that is no UTF-8", [](auto& m) { m.label.text = std::string("K\xfc"); });
  label.refuses("time of no clock", [](auto& m) { m.label.time = kNoTime; });
  label.refuses("infinite", [](auto& m) {
    m.label.map_from_label = SE3(Eigen::Quaterniond::Identity(), {kInfinity, 0, 0});
  });
}

TEST(Validation, AdminRequestAndReply) {
  const Spoiler<AdminRequest> request;
  request.refuses("no session", [](auto& m) { m.command.session = {}; });
  request.refuses("control character", [](auto& m) { m.request = std::string("\r"); });
  request.refuses("too much data", [](auto& m) { m.data.resize(kMaxAdminData + 1); });
  request.refuses("too much text", [](auto& m) { m.request.assign(kMaxAdminText + 1, 'x'); });
  const Spoiler<AdminReply> reply;
  reply.refuses("control character", [](auto& m) { m.text = std::string("\r"); });
  reply.refuses("too much data", [](auto& m) { m.data.resize(kMaxAdminData + 1); });
  reply.refuses("too much text", [](auto& m) { m.text.assign(kMaxAdminText + 1, 'x'); });
}

/// The largest of all: two images that do not pack at all.
TEST(Sizes, TheLargestLegalMessageIsSentAndTaken) {
  MapSeed seed = RandomMessages(kSeed).make<MapSeed>();
  constexpr uint32_t kSide = kMaxImageSide;
  constexpr size_t kMostOfAJpeg = size_t{kSide} * kSide + 64 * 1024;
  seed.first_image = {ImageEncoding::kJpeg, kSide, kSide, std::vector<uint8_t>(kMostOfAJpeg)};
  seed.second_image = seed.first_image;
  seed.trails.resize(kMaxTrails, Trail{{1}, {0, 0}, {0, 0}});
  seed.map_name.assign(kMaxNameBytes, 'x');
  seed.still_mask.assign(still_mask_bytes(kSide, kSide), 0);
  Scratch scratch;
  const auto sample = encode(seed, &scratch);
  const auto decoded = decode<MapSeed>(sample);
  EXPECT_TRUE(decoded.has_value()) << decoded.error().message;
  EXPECT_LT(internal::payload_bytes<MapSeed>(sample) * 21 / 20, internal::kMaxSampleBytes);
  seed.first_image.bytes.push_back(0);
  EXPECT_FALSE(decode<MapSeed>(encode(seed, &scratch)).has_value()) << "it was not the largest";
}

TEST(Validation, WearersCameras) {
  const Spoiler<WearerCamera> camera;
  camera.refuses("no name", [](auto& m) { m.name.clear(); });
  camera.refuses("no pixels", [](auto& m) { m.height = 0; });
  camera.refuses("huge", [](auto& m) { m.width = kMaxImageSide + 1; });
  const Spoiler<PictureRequest> request;
  request.refuses("nobody", [](auto& m) { m.name.clear(); });
  request.refuses("of every camera", [](auto& m) { m.camera = "*"; });
  const Spoiler<CameraPicture> camera_image;
  camera_image.refuses("no name", [](auto& m) { m.name = "Anna B."; });
  camera_image.refuses("time of no clock", [](auto& m) { m.time = kNoTime; });
  camera_image.refuses("unknown state", [](auto& m) { m.state = beyond<TrackingState>(); });
  camera_image.refuses("name too long", [](auto& m) { m.map.assign(kMaxNameBytes + 1, 'x'); });
  camera_image.refuses("control character", [](auto& m) { m.note = "a\nb"; });
  camera_image.refuses("no JPEG", [](auto& m) {
    m.image = {ImageEncoding::kRaw, 2, 2, std::vector<uint8_t>(4)};
  });
  camera_image.refuses("empty", [](auto& m) { m.image.bytes.clear(); });
  camera_image.refuses("wide", [](auto& m) { m.image.width = kMaxCameraImageSide + 1; });
  camera_image.refuses("more than a datagram", [](auto& m) {
    m.image.width = m.image.height = kMaxCameraImageSide;
    m.image.bytes.resize(kMaxCameraImageBytes + 1);
  });
}

TEST(Sizes, AnImageIsOneDatagramOfTheLoopbackProfile) {
  CameraPicture message;
  message.name.assign(kMaxNameLength, 'x');
  message.map.assign(kMaxNameBytes, 'x');
  message.note.assign(kMaxCameraPictureNote, 'x');
  message.image = {ImageEncoding::kJpeg, kMaxCameraImageSide, kMaxCameraImageSide,
                   std::vector<uint8_t>(kMaxCameraImageBytes)};
  Scratch scratch;
  EXPECT_LT(internal::payload_bytes<CameraPicture>(encode(message, &scratch)), 64'000U);
}

TEST(Sizes, StateSamplesStayBelow64kB) {
  PointPatches patches{{}, {}, {0, 1, std::vector<PointSource>(kBlockSlots)}};
  Scratch scratch;
  EXPECT_LT(internal::payload_bytes<PointPatches>(encode(patches, &scratch)), 64'000U);
  MapCommit commit;
  commit.name.assign(kMaxNameBytes, 'x');
  commit.points.resize(kMaxBlocks);
  commit.keyframe_versions.resize(kMaxKeyframeBlocks);
  commit.cameras.resize(kMaxCalibratedCameras);
  EXPECT_LT(internal::payload_bytes<MapCommit>(encode(commit, &scratch)), 64'000U);
  SeedVerdict verdict;
  verdict.points.resize(kMaxTrails);
  EXPECT_LT(internal::payload_bytes<SeedVerdict>(encode(verdict, &scratch)), 64U * 1024);
  AdminReply listing;  // a piece of an archive has no text to speak of
  listing.text.assign(kMaxAdminText, 'x');
  EXPECT_LT(internal::payload_bytes<AdminReply>(encode(listing, &scratch)), 64'000U);
  RelocQuery query;
  query.small_image = {ImageEncoding::kRaw, 80, 60, std::vector<uint8_t>(size_t{80} * 60)};
  query.corners.resize(std::accumulate(kPlaceCorners.begin(), kPlaceCorners.end(), size_t{0}));
  EXPECT_LT(internal::payload_bytes<RelocQuery>(encode(query, &scratch)), 64'000U);
  EXPECT_LT(internal::payload_bytes<TrackerStateMessage>(encode(TrackerStateMessage{}, &scratch)), 1300U);
  RigState rig;
  rig.rig.assign(kMaxNameLength, 'x');
  rig.commander.assign(kMaxNameLength, 'x');
  rig.ordered_by.assign(kMaxNameLength, 'x');
  rig.refusal.assign(kMaxRigText, 'x');
  rig.trouble.assign(kMaxRigTexts - kMaxRigText, 'x');
  rig.samples.resize(kMaxRigSamples);
  constexpr size_t kRoom = 64;  // for members that are to come
  EXPECT_LT(internal::payload_bytes<RigState>(encode(rig, &scratch)), 1300U - kRoom);
}

}  // namespace
}  // namespace cairn::wire
