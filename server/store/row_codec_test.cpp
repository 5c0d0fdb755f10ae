// SPDX-License-Identifier: Apache-2.0
#include "server/store/row_codec.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <random>

#include "common/base/utf8.h"
#include "common/map/label.h"
#include "server/store/entry_codec.h"

namespace cairn {
namespace {

constexpr unsigned kSeed = 4711;

/// Rows with random content, and what decoding one and encoding it again gives.
class RowCodecTest : public ::testing::Test {
 protected:
  struct Kind {
    const char* name;
    Blob row;
    std::function<std::optional<Blob>(const Blob&)> again;
  };

  RowCodecTest() {
    cameras_[7] = *make_camera(camera_);
    cameras_[calibrated_camera_row(2)] = *make_camera(camera_);
    cameras_[8] = *make_camera({CameraModel::kFov, 320, 240, {200, 201, 160, 120, 0.9}});
  }

  double number() { return std::uniform_real_distribution<double>(-3, 3)(random_); }
  float small() { return static_cast<float>(number()); }
  uint64_t id() { return random_() % 100'000 + 1; }
  SE3 pose() {
    return {Eigen::Quaterniond(number(), number(), number(), number()).normalized(),
            {number(), number(), number()}};
  }

  KeyframeRecord keyframe() {
    return {KeyframeId{9},
            KeyframeId{4},
            cameras_[8],
            Timestamp{-17},
            pose(),
            number() + 3,
            1 / (number() + 4),
            10 * (number() + 3),
            true,
            -1,
            {},
            UpDirection{{0, 0.6, -0.8}, 0.02},
            true};
  }
  MapCamera calibrated_camera() {
    MapCamera camera =
        make_map_camera(cameras_[calibrated_camera_row(2)], {{ClientId{{1, 2}}, 3, 4}, {0.1, 0.2}});
    camera.judged = {number(), number()};
    camera.searched = {number(), number()};
    camera.judged_keyframes = 17;
    camera.agreements = 2;
    camera.frozen = true;
    return camera;
  }
  MeasurementsRecord measurements() {
    MeasurementsRecord record{KeyframeId{9}, {}, {PointId{3}, PointId{5'000'000'000}}};
    uint64_t point = 0;
    for (int i = 0; i < 500; ++i) {
      point += random_() % 5 + 1;
      record.measurements.push_back(
          {PointId{point}, static_cast<uint8_t>(random_() % 4), {small(), small()}});
    }
    return record;
  }
  SourcesRecord sources() {
    SourcesRecord record{3, {}};
    for (int i = 0; i < 40; ++i) {
      PointSource& p = record.points.emplace_back();
      p.id = PointId{3 * kBlockSlots + static_cast<uint64_t>(i) + 1};
      p.keyframe = KeyframeId{id()};
      p.level = static_cast<uint8_t>(random_() % 4);
      p.corner = {static_cast<int16_t>(random_() % 4096), static_cast<int16_t>(random_() % 4096)};
      for (auto* vector : {&p.ray_center, &p.ray_right, &p.ray_down, &p.normal})
        *vector = Eigen::Vector3f(small(), small(), 4 + small()).normalized();
      for (uint8_t& pixel : p.pixels) pixel = static_cast<uint8_t>(random_());
    }
    return record;
  }
  PositionsRecord positions() {
    PositionsRecord record{3, {}};
    for (int i = 0; i < kBlockSlots; ++i)
      record.points.push_back({{number(), number(), number()}, i, i / 2, i % 3 != 0});
    return record;
  }
  WorkRecord work() {
    return {{{KeyframeId{5}, 2, 777, 31},
             {KeyframeId{6}, 0, 0, 0, Box{{-1, -2, -3}, {1, 2, 0.5}}},
             {KeyframeId{7}, 1, 0, 0, Sphere{{0, 1, 0}, 2.5}}},
            {PointId{id()}, PointId{id()}},
            KeyframeId{6},
            true,
            false,
            true};
  }

  std::vector<Kind> kinds() {
    const auto again = [](const auto& decoded, auto encode) {
      return decoded ? std::optional(encode(*decoded)) : std::nullopt;
    };
    const FoundationRecord foundation{0.07, true};
    return {
        {"camera", encode_camera(camera_),
         [again](const Blob& row) { return again(decode_camera(row), encode_camera); }},
        {"calibrated camera", encode_calibrated_camera(calibrated_camera()),
         [this, again](const Blob& row) {
           return again(decode_calibrated_camera(2, row, cameras_),
                        [](const CalibratedCameraRecord& r) { return encode_calibrated_camera(r.camera); });
         }},
        {"keyframe", encode_keyframe(keyframe(), 8),
         [this, again](const Blob& row) {
           return again(decode_keyframe(KeyframeId{9}, row, cameras_), [this](const KeyframeRecord& k) {
             return encode_keyframe(k, k.camera == cameras_[8] ? 8 : 7);
           });
         }},
        {"measurements", encode_measurements(measurements()),
         [again](const Blob& row) {
           return again(decode_measurements(KeyframeId{9}, row), encode_measurements);
         }},
        {"sources", encode_sources(sources()),
         [again](const Blob& row) { return again(decode_sources(3, row), encode_sources); }},
        {"positions", encode_positions(positions()),
         [again](const Blob& row) { return again(decode_positions(3, row), encode_positions); }},
        {"foundation", encode_foundation(foundation),
         [again](const Blob& row) { return again(decode_foundation(row), encode_foundation); }},
        {"work", encode_work(work()),
         [again](const Blob& row) { return again(decode_work(row), encode_work); }},
    };
  }

  std::mt19937_64 random_{kSeed};
  CameraParameters camera_{CameraModel::kPinholeRadtan, 640, 480, {525, 526, 319, 239, -0.1, 0.01, 0, 0, 0}};
  CameraRows cameras_;
};

/// As they were written while points of the start held the unit of length.
TEST_F(RowCodecTest, AFoundationWithAnchorsIsReadWithoutThem) {
  const Blob now = encode_foundation({0.07, true});
  Blob before(now.begin(), now.end() - sizeof(uint32_t));
  ByteWriter anchors;
  anchors.put(uint32_t{2});
  for (const auto& [point, distance] : {std::pair(uint64_t{1}, 0.5), std::pair(uint64_t{9}, 1.25)}) {
    anchors.put(point);
    anchors.put(distance);
  }
  const Blob list = anchors.take();
  before.insert(before.end(), list.begin(), list.end());
  const auto read = decode_foundation(before);
  ASSERT_TRUE(read);
  EXPECT_EQ(encode_foundation(*read), now);
}

/// Nobody who receives a map would take it.
TEST_F(RowCodecTest, WhatCannotBeSentIsNotRead) {
  const auto of_keyframe = [this](const std::function<void(KeyframeRecord&)>& spoil) {
    KeyframeRecord record = keyframe();
    spoil(record);
    return decode_keyframe(KeyframeId{9}, encode_keyframe(record, 8), cameras_).has_value();
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(of_keyframe([](KeyframeRecord&) {}));
  EXPECT_FALSE(
      of_keyframe([](KeyframeRecord& k) { k.time.nanoseconds = std::numeric_limits<int64_t>::min(); }));
  EXPECT_FALSE(of_keyframe([](KeyframeRecord& k) { k.mean_depth = -1; }));
  EXPECT_FALSE(of_keyframe([](KeyframeRecord& k) { k.near_depth = kNan; }));
  EXPECT_FALSE(of_keyframe([](KeyframeRecord& k) {
    k.camera_from_map = SE3(Eigen::Quaterniond::Identity(), {1e7, 0, 0});
  }));

  const auto of_source = [this](const std::function<void(PointSource&)>& spoil) {
    SourcesRecord record = sources();
    spoil(record.points[7]);
    return decode_sources(3, encode_sources(record)).has_value();
  };
  EXPECT_TRUE(of_source([](PointSource&) {}));
  EXPECT_FALSE(of_source([](PointSource& p) { p.ray_down *= 1.1F; }));
  EXPECT_FALSE(of_source([](PointSource& p) { p.normal.setZero(); }));
  EXPECT_FALSE(of_source([](PointSource& p) { p.corner.x = -1; }));

  MeasurementsRecord seen = measurements();
  seen.measurements[3].pixel.x() = 1e30F;
  EXPECT_FALSE(decode_measurements(KeyframeId{9}, encode_measurements(seen)));

  LabelRecord label;
  label.id = 1;
  label.text = "kettle";
  EXPECT_TRUE(decode_label(1, encode_label(label)));
  label.time.nanoseconds = std::numeric_limits<int64_t>::max();
  EXPECT_FALSE(decode_label(1, encode_label(label)));
}

TEST_F(RowCodecTest, WhatIsReadIsWhatWasWritten) {
  for (const Kind& kind : kinds()) {
    SCOPED_TRACE(kind.name);
    const auto again = kind.again(kind.row);
    ASSERT_TRUE(again);
    EXPECT_EQ(*again, kind.row);
  }
  const KeyframeRecord k = keyframe();
  const auto by_found = decode_keyframe(k.id, encode_keyframe(k, calibrated_camera_row(2)), cameras_);
  ASSERT_TRUE(by_found);
  EXPECT_EQ(by_found->estimated_camera, 2);
  EXPECT_EQ(by_found->camera, cameras_[calibrated_camera_row(2)]);
  const auto read = decode_keyframe(k.id, encode_keyframe(k, 8), cameras_);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->id, k.id);
  EXPECT_EQ(read->camera, k.camera);
  EXPECT_EQ(read->camera_from_map.rotation().coeffs(), k.camera_from_map.rotation().coeffs());
  const SourcesRecord s = sources();
  EXPECT_EQ(decode_sources(3, encode_sources(s))->points[39].id, s.points[39].id);
}

TEST_F(RowCodecTest, ACameraThatNobodyCouldHaveAnnouncedIsRefused) {
  const auto is_taken = [this](const MapCamera& camera) {
    return decode_calibrated_camera(2, encode_calibrated_camera(camera), cameras_).has_value();
  };
  const MapCamera sound = calibrated_camera();
  ASSERT_TRUE(is_taken(sound));
  for (const double sigma : {0.0, 1e-9, 1.1, -0.1, std::nan("")}) {
    for (const int i : {0, 1}) {
      MapCamera other = sound;
      other.prior_sigma[i] = sigma;
      EXPECT_FALSE(is_taken(other)) << i << ": " << sigma;
      other = sound;
      other.sigma[i] = sigma;
      EXPECT_FALSE(is_taken(other)) << i << ": " << sigma;
    }
  }
  for (const double log_focal : {-3.0, 12.0, 1e4}) {
    MapCamera other = sound;
    other.prior_mean[0] = log_focal;
    EXPECT_FALSE(is_taken(other)) << log_focal;
  }
  const std::vector<double> fewer{525, 526, 319, 239};
  const std::vector<double> longer{1e5, 1e5, 319, 239, 0, 0, 0, 0, 0};
  for (const auto& values : {fewer, longer}) {
    cameras_[calibrated_camera_row(2)] = *make_camera({CameraModel::kPinholeRadtan, 640, 480, values});
    EXPECT_FALSE(is_taken(sound)) << values.size();
  }
  cameras_[calibrated_camera_row(2)] = cameras_[8];
  EXPECT_FALSE(is_taken(sound)) << "another model";
}

TEST_F(RowCodecTest, CutAndLengthenedRowsAreRefused) {
  for (const Kind& kind : kinds()) {
    SCOPED_TRACE(kind.name);
    for (size_t size = 0; size < kind.row.size(); size += 1 + kind.row.size() / 300)
      EXPECT_FALSE(kind.again(Blob(kind.row.begin(), kind.row.begin() + static_cast<ptrdiff_t>(size))));
    Blob longer = kind.row;
    longer.push_back(0);
    EXPECT_FALSE(kind.again(longer));
  }
}

TEST_F(RowCodecTest, NoBytesDoHarm) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  for (const Kind& kind : kinds()) {
    for (int i = 0; i < 300; ++i) {
      Blob row = kind.row;
      for (int flips = 0; flips < 3; ++flips) row[random_() % row.size()] ^= static_cast<uint8_t>(random_());
      (void)kind.again(row);  // sanitizers judge
      for (uint8_t& byte : row) byte = static_cast<uint8_t>(random_());
      (void)kind.again(row);
    }
  }
}

TEST_F(RowCodecTest, AKeyframeMaySayWhatStandsStill) {
  KeyframeRecord masked = keyframe();
  const Blob without = encode_keyframe(masked, 8);
  std::vector<uint8_t> bits(still_mask_bytes(320, 240), 0);
  bits[7] = 0x12;
  masked.still = still_mask_of(320, 240, bits);
  const Blob with = encode_keyframe(masked, 8);
  EXPECT_EQ(with.size(), without.size() + bits.size());
  const auto read = decode_keyframe(masked.id, with, cameras_);
  ASSERT_TRUE(read);
  EXPECT_EQ(bits_of(read->still), bits);

  const auto unmasked = decode_keyframe(masked.id, without, cameras_);
  ASSERT_TRUE(unmasked);
  EXPECT_EQ(unmasked->still, nullptr);
  const std::span<const uint8_t> cut(with.data(), with.size() - 1);
  EXPECT_FALSE(decode_keyframe(masked.id, cut, cameras_)) << "no mask of this camera";
}

TEST_F(RowCodecTest, NumbersThatNoMapHasAreRefused) {
  KeyframeRecord far = keyframe();
  far.camera_from_map = SE3(Eigen::Quaterniond::Identity(), {1e9, 0, 0});
  EXPECT_FALSE(decode_keyframe(far.id, encode_keyframe(far, 8), cameras_));
  EXPECT_FALSE(decode_keyframe(far.id, encode_keyframe(keyframe(), 99), cameras_)) << "no such camera";
  MeasurementsRecord twice = measurements();
  twice.measurements[1].point = twice.measurements[0].point;
  EXPECT_FALSE(decode_measurements(twice.keyframe, encode_measurements(twice)));
  MeasurementsRecord level = measurements();
  level.measurements[0].level = kPyramidLevels;
  EXPECT_FALSE(decode_measurements(level.keyframe, encode_measurements(level)));
  PositionsRecord nan = positions();
  nan.points[5].position.y() = std::nan("");
  EXPECT_FALSE(decode_positions(3, encode_positions(nan)));
}

TEST_F(RowCodecTest, ARemovedPointThatWasNowhereCostsNoOther) {
  PositionsRecord record = positions();
  record.points[5].live = false;
  record.points[5].position = {std::nan(""), 1e9, 0};
  const auto read = decode_positions(3, encode_positions(record));
  ASSERT_TRUE(read);
  EXPECT_TRUE(read->points[5].position.isZero());
  EXPECT_EQ(read->points[4].position, record.points[4].position);
}

/// What an archive of strangers, or a store of before, has for text.
TEST_F(RowCodecTest, TextsThatAreNoneAreMadeSafeToShow) {
  LabelRecord label;
  label.id = 1;
  for (const std::string& text : {std::string("Küche"), std::string("K\xfc"), std::string("a\u202eb"),
                                  std::string(kMaxLabelBytes, '\xff')}) {
    label.text = label.author = text;
    const auto read = decode_label(1, encode_label(label));
    ASSERT_TRUE(read) << one_line(text);
    EXPECT_EQ(read->text, cut_text(one_line(text), kMaxLabelBytes));
    EXPECT_EQ(fault_of_text(read->author), std::nullopt);
    CountedHeader header;
    header.header.id.bytes[0] = 1;
    header.header.name = text;
    const auto named = decode_header(encode_header(header));
    ASSERT_TRUE(named);
    EXPECT_EQ(fault_of_text(named->header.name), std::nullopt);
  }
}

TEST_F(RowCodecTest, ImagesAreKeptPixelByPixel) {
  GrayImage image(101, 57);  // rows are padded
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) image.row(y)[x] = static_cast<uint8_t>(random_());
  }
  const GrayImagePtr read = decode_image_row(encode_image_row(image));
  ASSERT_NE(read, nullptr);
  ASSERT_EQ(read->width(), image.width());
  ASSERT_EQ(read->height(), image.height());
  for (int y = 0; y < image.height(); ++y)
    ASSERT_EQ(std::memcmp(read->row(y), image.row(y), static_cast<size_t>(image.width())), 0);
  EXPECT_EQ(decode_image_row(Blob{1, 2, 3}), nullptr);
}

}  // namespace
}  // namespace cairn
