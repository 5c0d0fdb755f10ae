// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <random>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "common/base/enumerators.h"
#include "common/image/limits.h"
#include "common/wire/messages.h"
#include "common/wire/rig_messages.h"
#include "common/wire/wearer_messages.h"

/// Random but valid messages, and member-by-member comparison, for the tests of the wire.
namespace cairn::wire::testing {

// A member added to a struct and forgotten here does not compile.
#define CAIRN_MEMBERS(Type, ...)           \
  inline auto members(const Type& value) { \
    const auto& [__VA_ARGS__] = value;     \
    return std::tie(__VA_ARGS__);          \
  }
CAIRN_MEMBERS(ImageMessage, a, b, c, d)
CAIRN_MEMBERS(Trail, a, b, c)
CAIRN_MEMBERS(PointMeasurement, a, b, c)
CAIRN_MEMBERS(PointSource, a, b, c, d, e, f, g, h, i)
CAIRN_MEMBERS(PatchBlock, a, b, c)
CAIRN_MEMBERS(PointVisibility, a, b, c, d)
CAIRN_MEMBERS(PositionBlock, a, b, c, d, e)
CAIRN_MEMBERS(KeyframePose, a, b, c)
CAIRN_MEMBERS(KeyframeBlock, a, b, c, d)
CAIRN_MEMBERS(BlockVersion, a, b, c)
CAIRN_MEMBERS(OfferOutcome, a, b, c, d, e, f, g)
CAIRN_MEMBERS(CameraMessage, a, b, c, d, e, f)
CAIRN_MEMBERS(MapSeed, a, b, c, d, e, f, g, h, i, j, k, l, m, n)
CAIRN_MEMBERS(PointCandidate, a, b, c, d, e)
CAIRN_MEMBERS(KeyframeOffer, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r)
CAIRN_MEMBERS(TrackerStateMessage, a, b, c, d, e, f, g, h, i, j)
CAIRN_MEMBERS(ServerStatus, a, b, c, d, e, f, g)
CAIRN_MEMBERS(MapInfo, a, b, c, d, e, f, g, h, i, j, k, l, m)
CAIRN_MEMBERS(PointPatches, a, b, c)
CAIRN_MEMBERS(PointPositions, a, b, c)
CAIRN_MEMBERS(KeyframePoses, a, b, c)
CAIRN_MEMBERS(CameraVersion, a, b, c)
CAIRN_MEMBERS(CameraEstimate, a, b, c, d, e, f, g, h, i)
CAIRN_MEMBERS(MapCommit, a, b, c, d, e, f, g, h)
CAIRN_MEMBERS(SeedVerdict, a, b, c, d, e, f, g, h, i, j)
CAIRN_MEMBERS(OfferVerdict, a, b, c, d, e)
CAIRN_MEMBERS(PlaceCorner, a, b, c)
CAIRN_MEMBERS(RelocQuery, a, b, c, d, e, f, g, h, i, j)
CAIRN_MEMBERS(PlaceCandidate, a, b, c, d, e, f, g, h, i, j, k)
CAIRN_MEMBERS(RelocalizationAnswer, a, b, c)
CAIRN_MEMBERS(RelocAnswer, a, b, c)
CAIRN_MEMBERS(ClientRequest, a, b, c, d, e, f, g, h, i, j)
CAIRN_MEMBERS(RequestOutcome, a, b, c, d, e)
CAIRN_MEMBERS(ClientReply, a, b, c, d, e)
CAIRN_MEMBERS(Label, a, b, c, d, e, f)
CAIRN_MEMBERS(LabelMessage, a, b, c)
CAIRN_MEMBERS(AdminRequest, a, b, c, d)
CAIRN_MEMBERS(AdminReply, a, b, c, d, e)
CAIRN_MEMBERS(RigCommand, a, b, c, d, e, f, g, h, i, j)
CAIRN_MEMBERS(RigAxisState, a, b, c, d, e)
CAIRN_MEMBERS(RigImu, a, b, c, d, e, f)
CAIRN_MEMBERS(RigCameraClock, a, b, c)
CAIRN_MEMBERS(RigImuSample, a, b, c)
CAIRN_MEMBERS(RigState, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, s, t, u, v, w, x)
CAIRN_MEMBERS(WearerCamera, a, b, c)
CAIRN_MEMBERS(PictureRequest, a, b)
CAIRN_MEMBERS(CameraPicture, a, b, c, d, e, f)
#undef CAIRN_MEMBERS

/// Equal in every member; poses up to the rounding of one normalization.
template <typename T>
bool same(const T& x, const T& y);
inline bool same(const SE3& x, const SE3& y) {
  return x.rotation().coeffs().isApprox(y.rotation().coeffs(), 1e-15) && x.translation() == y.translation();
}
inline bool same(const UpDirection& x, const UpDirection& y) {
  return x.up.isApprox(y.up, 1e-6) && x.sigma == y.sigma;
}
inline bool same(const Eigen::Quaterniond& x, const Eigen::Quaterniond& y) {
  return x.coeffs() == y.coeffs();
}
template <typename T>
bool same(const std::vector<T>& x, const std::vector<T>& y) {
  return std::equal(x.begin(), x.end(), y.begin(), y.end(),
                    [](const T& a, const T& b) { return same(a, b); });
}
template <typename T>
bool same(const std::optional<T>& x, const std::optional<T>& y) {
  return x.has_value() == y.has_value() && (!x || same(*x, *y));
}
template <typename T, size_t N>
bool same(const std::array<T, N>& x, const std::array<T, N>& y) {
  return std::equal(x.begin(), x.end(), y.begin(), [](const T& a, const T& b) { return same(a, b); });
}
template <typename T>
bool same(const T& x, const T& y) {
  if constexpr (requires { members(x); }) {
    return [&]<size_t... I>(std::index_sequence<I...>, const auto& a, const auto& b) {
      return (same(std::get<I>(a), std::get<I>(b)) && ...);
    }
    (std::make_index_sequence<std::tuple_size_v<decltype(members(x))>>(), members(x), members(y));
  } else {
    return x == y;
  }
}

class RandomMessages {
 public:
  explicit RandomMessages(unsigned seed) : random_(seed) {}

  template <typename Message>
  Message make();

  uint64_t number(uint64_t low = 1, uint64_t high = ~uint64_t{0}) {
    return std::uniform_int_distribution<uint64_t>(low, high)(random_);
  }
  float uniform(float low, float high) { return std::uniform_real_distribution<float>(low, high)(random_); }
  bool coin() { return number(0, 1) == 1; }
  template <BoundedEnum Enum>
  Enum any() {
    return static_cast<Enum>(number(0, kEnumerators<Enum> - 1));
  }
  CameraModel camera_model() {
    const auto models = camera_models();
    return models[number(0, models.size() - 1)];
  }

  template <typename Id>
  Id id() {
    Id made;
    for (uint8_t& byte : made.bytes) byte = static_cast<uint8_t>(number(0, 255));
    return made;
  }
  std::string text(size_t max) {
    std::string made(number(0, max), ' ');
    for (char& c : made) c = static_cast<char>(number(0x20, 0x7e));
    return made;
  }
  Eigen::Vector3f vector(float range) {
    return {uniform(-range, range), uniform(-range, range), uniform(-range, range)};
  }
  Eigen::Vector3f direction() { return Eigen::Vector3f(vector(1) + Eigen::Vector3f(0, 0, 3)).normalized(); }
  Eigen::Vector2f pixel() { return {uniform(-10, 2000), uniform(-10, 2000)}; }
  SE3 pose() {
    return {Eigen::Quaterniond(Eigen::AngleAxisd(uniform(-3, 3), direction().cast<double>())),
            vector(100).cast<double>()};
  }
  std::optional<UpDirection> up() {
    if (coin()) return std::nullopt;
    return UpDirection{direction().cast<double>().normalized(), uniform(0.01F, 0.1F)};
  }
  ImageMessage image(uint32_t width, uint32_t height) {
    ImageMessage made{ImageEncoding::kRaw, width, height, std::vector<uint8_t>(size_t{width} * height)};
    if (coin()) {
      made.encoding = ImageEncoding::kJpeg;
      made.bytes.resize(number(1, made.bytes.size()));
    }
    for (uint8_t& byte : made.bytes) byte = static_cast<uint8_t>(random_());
    return made;
  }
  std::vector<uint8_t> still_mask(uint32_t width, uint32_t height) {
    if (coin()) return {};
    return std::vector<uint8_t>((size_t{width / 8} * (height / 8) + 7) / 8,
                                static_cast<uint8_t>(number(0, 255)));
  }
  uint64_t live(size_t slots) {
    return number(0) & (slots >= kBlockSlots ? ~uint64_t{0} : (uint64_t{1} << slots) - 1);
  }
  CommandId command() { return {{number()}, number()}; }
  PointSource source(PointId point) {
    PointSource made{point,       {number()},  static_cast<uint8_t>(number(0, 3)),
                     {},          direction(), direction(),
                     direction(), direction(), {}};
    made.corner = {static_cast<int16_t>(number(0, 4095)), static_cast<int16_t>(number(0, 4095))};
    for (uint8_t& byte : made.pixels) byte = static_cast<uint8_t>(random_());
    return made;
  }

 private:
  std::mt19937_64 random_;
};

template <>
inline CameraMessage RandomMessages::make() {
  CameraMessage made{
      id<ClientId>(), static_cast<uint32_t>(number(0, 9)), static_cast<uint32_t>(number(1, 9)), {}, {},
      coin()};
  made.parameters.model = camera_model();
  made.parameters.width = static_cast<int>(number(1, kMaxImageSide));
  made.parameters.height = static_cast<int>(number(1, kMaxImageSide));
  for (int i = 0; i < 9; ++i) made.parameters.values.push_back(uniform(-500, 500));
  if (coin()) made.sigma.assign(9, uniform(0, 1));
  return made;
}
template <>
inline CameraEstimate RandomMessages::make() {
  auto camera = make<CameraMessage>();
  return {camera.client,
          camera.camera,
          id<MapId>(),
          {number()},
          camera.version,
          std::move(camera.parameters),
          std::move(camera.sigma),
          coin(),
          coin()};
}
template <>
inline MapSeed RandomMessages::make() {
  const auto width = static_cast<uint32_t>(number(1, 320));
  const auto height = static_cast<uint32_t>(number(1, 240));
  MapSeed made{id<ClientId>(),
               command(),
               1,
               2,
               coin(),
               {static_cast<int64_t>(number(0, 1'000'000))},
               {12345},
               {},
               {},
               {},
               pose(),
               text(40),
               {},
               up()};
  made.still_mask = still_mask(width, height);
  made.first_image = image(width, height);
  made.second_image = image(width, height);
  for (uint64_t i = 0, n = number(0, 300); i < n; ++i) made.trails.push_back({{number()}, pixel(), pixel()});
  return made;
}
template <>
inline KeyframeOffer RandomMessages::make() {
  KeyframeOffer made{
      id<ClientId>(), command(), id<MapId>(), {number()}, {number()}, {number()}, pose(), 3,    4,
      coin(),         {-7},      {},          {},         {},         0,          {},     up(), coin()};
  made.image = image(static_cast<uint32_t>(number(1, 320)), static_cast<uint32_t>(number(1, 240)));
  made.still_mask = still_mask(made.image.width, made.image.height);
  made.reference_command = number(0, made.command.seq - 1);
  for (uint64_t i = 0, n = number(0, kMaxCandidates); i < n; ++i) {
    made.candidates.push_back(
        {{number()}, static_cast<uint8_t>(number(0, 3)), pixel(), uniform(0.01F, 9), uniform(0.01F, 9)});
  }
  for (uint64_t i = 0, n = number(0, 300); i < n; ++i) {
    made.measurements.push_back({{number()}, static_cast<uint8_t>(number(0, 3)), pixel()});
  }
  return made;
}
template <>
inline TrackerStateMessage RandomMessages::make() {
  return {id<ClientId>(),
          {number()},
          any<TrackingState>(),
          id<MapId>(),
          {number()},
          {number()},
          pose(),
          uniform(0, 1),
          {static_cast<int64_t>(number(0, 1) << 61)},
          coin() ? "" : "anna-" + std::to_string(number(0, 99))};
}
template <>
inline ServerStatus RandomMessages::make() {
  return {id<ServerId>(), number(), text(20), text(40), static_cast<uint32_t>(number(0, 99)), 7,
          uniform(0, 1)};
}
template <>
inline MapInfo RandomMessages::make() {
  return {id<MapId>(),
          text(64),
          {number()},
          {number()},
          17,
          99,
          vector(5) - Eigen::Vector3f::Constant(20),
          vector(5) + Eigen::Vector3f::Constant(20),
          coin(),
          coin(),
          any<MapRight>(),
          id<ServerId>(),
          coin()};
}
template <>
inline PointPatches RandomMessages::make() {
  PointPatches made{
      id<MapId>(), {number()}, {static_cast<uint32_t>(number(0, kMaxBlocks - 1)), number(), {}}};
  for (uint64_t i = 0, n = number(0, kBlockSlots), point = 0; i < n; ++i)
    made.block.points.push_back(source({point += number(1, 9)}));
  return made;
}
template <>
inline PointPositions RandomMessages::make() {
  PointPositions made{
      id<MapId>(), {number()}, {static_cast<uint32_t>(number(0, kMaxBlocks - 1)), number(), 0, {}, {}}};
  const size_t count = number(0, kBlockSlots);
  made.block.live = live(count);
  for (size_t i = 0; i < count; ++i) {
    made.block.positions.push_back(vector(100));
    made.block.visibility.push_back(
        {coin() ? direction() : Eigen::Vector3f(0, 0, 0), uniform(-1, 1), uniform(0, 9), uniform(0, 9)});
  }
  return made;
}
template <>
inline KeyframePoses RandomMessages::make() {
  KeyframePoses made{
      id<MapId>(), {number()}, {static_cast<uint32_t>(number(0, kMaxKeyframeBlocks - 1)), number(), 0, {}}};
  const size_t count = number(0, kBlockSlots);
  made.block.live = live(count);
  for (size_t i = 0, keyframe = 0; i < count; ++i)
    made.block.keyframes.push_back({{keyframe += number(1, 9)}, pose(), uniform(0, 9)});
  return made;
}
template <>
inline MapCommit RandomMessages::make() {
  MapCommit made{id<MapId>(), text(64), {number()}, {number()}, coin(), {}, {}, {}};
  for (uint64_t i = 0, n = number(0, 3); i < n; ++i) made.cameras.push_back({id<ClientId>(), 1, 2});
  for (uint32_t i = 0, n = static_cast<uint32_t>(number(0, 500)); i < n; ++i)
    made.points.push_back({i, number(), number()});
  for (uint64_t i = 0, n = number(0, 50); i < n; ++i) made.keyframe_versions.push_back(number());
  return made;
}
template <>
inline SeedVerdict RandomMessages::make() {
  SeedVerdict made{id<ClientId>(), command(),  coin(),     text(100),  id<MapId>(),
                   {number()},     {number()}, {number()}, {number()}, {}};
  for (uint64_t i = 0, n = number(0, 500); i < n; ++i)
    made.points.emplace_back(TrailId{number()}, PointId{number()});
  return made;
}
template <>
inline OfferVerdict RandomMessages::make() {
  OfferVerdict made{id<ClientId>(), {number()}, number(), static_cast<uint32_t>(number(0, 9)), {}};
  for (uint64_t i = 0, n = number(0, kMaxOutcomes); i < n; ++i) {
    made.recent.push_back(
        {number(), any<OfferDecision>(), text(60), id<MapId>(), {number()}, {number()}, {number()}});
  }
  return made;
}

template <>
inline RelocQuery RandomMessages::make() {
  RelocQuery made{id<ClientId>(), command(), id<MapId>(), 3, 4, coin(), {12345}, {}, {}, up()};
  made.small_image = image(static_cast<uint32_t>(number(1, 80)), static_cast<uint32_t>(number(1, 60)));
  made.small_image.encoding = ImageEncoding::kRaw;
  made.small_image.bytes.resize(size_t{made.small_image.width} * made.small_image.height);
  for (uint64_t i = 0, n = number(0, 300); i < n; ++i) {
    made.corners.push_back(
        {pixel(), static_cast<uint8_t>(number(0, 3)), {number(0), number(0), number(0), number(0)}});
  }
  return made;
}
template <>
inline RelocAnswer RandomMessages::make() {
  RelocAnswer made{id<ClientId>(), command(), {any<RelocalizationVerdict>(), {}, text(60)}};
  for (uint64_t i = 0, n = number(1, kMaxPlaceCandidates); i < n; ++i) {
    made.answer.candidates.push_back({id<MapId>(),
                                      {number()},
                                      {number()},
                                      {number()},
                                      pose(),
                                      uniform(-1, 1),
                                      static_cast<int>(number(0, 99)),
                                      static_cast<int>(number(0, 99)),
                                      static_cast<int>(number(0, 99)),
                                      coin(),
                                      text(30)});
  }
  return made;
}

template <>
inline ClientRequest RandomMessages::make() {
  return {id<ClientId>(),   command(), any<RequestAction>(), id<MapId>(), {number()},
          any<LabelKind>(), text(40),  {number()},           {number()},  pose()};
}
template <>
inline ClientReply RandomMessages::make() {
  ClientReply made{id<ClientId>(), {number()}, number(), static_cast<uint32_t>(number(0, 9)), {}};
  for (uint64_t i = 0, n = number(0, kMaxOutcomes); i < n; ++i) {
    made.recent.push_back({number(), any<RequestDecision>(), text(60), id<MapId>(), {number()}});
  }
  return made;
}
template <>
inline LabelMessage RandomMessages::make() {
  return {id<MapId>(), {number()}, {{number()}, any<LabelKind>(), text(40), pose(), text(32), {12345}}};
}
template <>
inline AdminRequest RandomMessages::make() {
  return {id<ClientId>(), command(), text(200), std::vector<uint8_t>(number(0, 500), 7)};
}
template <>
inline AdminReply RandomMessages::make() {
  return {id<ClientId>(), command(), static_cast<uint8_t>(number(0, 6)), text(200),
          std::vector<uint8_t>(number(0, 500), 7)};
}
template <>
inline RigCommand RandomMessages::make() {
  return {"rig-" + std::to_string(number(0, 99)),
          "commander-" + std::to_string(number(0, 99)),
          command(),
          any<RigMode>(),
          vector(5).cast<double>(),
          {static_cast<int64_t>(number(0, 1) << 61)},
          {uniform(-1, 1), uniform(-1, 1)},
          {uniform(-3, 3), uniform(-3, 3)},
          any<RigSearchPattern>(),
          std::vector<Eigen::Vector3d>(number(0, kMaxFurtherDirections), vector(3).cast<double>())};
}
template <>
inline RigAxisState RandomMessages::make() {
  return {any<RigAxisCondition>(), static_cast<uint8_t>(number(0, 8)), coin(), uniform(-1, 1),
          uniform(-3, 3)};
}
template <>
inline RigState RandomMessages::make() {
  std::vector<RigImuSample> samples;
  for (int64_t i = 0, n = static_cast<int64_t>(number(0, kMaxRigSamples)); i < n; ++i)
    samples.push_back({{i * 10}, vector(3), vector(9)});
  const auto perhaps = [this] { return coin() ? std::optional(pose().rotation()) : std::nullopt; };
  const RigImu imu{
      {static_cast<int64_t>(number(0, 1) << 61)}, vector(3), vector(9), coin(), pose().rotation(),
      static_cast<int64_t>(number(0, 99))};
  return {"rig-" + std::to_string(number(0, 99)),
          {static_cast<int64_t>(number(0, 1) << 61)},
          any<RigMode>(),
          coin() ? "" : "commander-" + std::to_string(number(0, 99)),
          command(),
          text(40),
          coin(),
          coin(),
          {make<RigAxisState>(), make<RigAxisState>()},
          coin(),
          imu,
          text(60),
          coin(),
          coin(),
          coin(),
          uniform(0, 1),
          static_cast<uint32_t>(number(0, 9)),
          {coin(), static_cast<int64_t>(number(0, 99)), uniform(0, 1)},
          coin() ? "" : "commander-" + std::to_string(number(0, 99)),
          any<RigMode>(),
          std::move(samples),
          perhaps(),
          coin() ? std::optional(static_cast<int64_t>(number(0, 99))) : std::nullopt,
          perhaps()};
}
template <>
inline WearerCamera RandomMessages::make() {
  return {"camera-" + std::to_string(number(0, 99)), static_cast<uint32_t>(number(1, kMaxImageSide)),
          static_cast<uint32_t>(number(1, kMaxImageSide))};
}
template <>
inline PictureRequest RandomMessages::make() {
  return {"viewer-" + std::to_string(number(0, 99)), coin() ? "" : "camera-" + std::to_string(number(0, 99))};
}
template <>
inline CameraPicture RandomMessages::make() {
  ImageMessage jpeg = image(64, 48);
  jpeg.encoding = ImageEncoding::kJpeg;
  return {"camera-" + std::to_string(number(0, 99)),
          {static_cast<int64_t>(number(0, 1) << 61)},
          any<TrackingState>(),
          text(30),
          text(60),
          std::move(jpeg)};
}

}  // namespace cairn::wire::testing
