// SPDX-License-Identifier: Apache-2.0
#include "client/app/eval/truth.h"

#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <iomanip>
#include <sstream>

#include "common/io/test_directory.h"
#include "common/io/text.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int64_t kStart = 1'403'636'580'000'000'000;
constexpr int64_t kStep = 50'000'000;  // [ns]

/// A path that turns about all axes; pose `i`.
SE3 pose_at(int i) {
  const double t = i / 20.0;
  return {so3_exp(Eigen::Vector3d(0.6 * std::sin(t), 0.5 * std::sin(0.7 * t + 1), 0.8 * std::cos(0.4 * t))),
          Eigen::Vector3d(std::sin(0.7 * t), 0.8 * std::cos(0.5 * t), 0.3 * std::sin(1.1 * t))};
}

const SE3 kBodyFromCamera(so3_exp(Eigen::Vector3d(0.2, -1.3, 0.4)), Eigen::Vector3d(-0.02, 0.3, 0.01));
const SE3 kBodyFromMarker(so3_exp(Eigen::Vector3d(-0.4, 0.1, 1.2)), Eigen::Vector3d(0.07, -0.13, 0.02));

std::string sensor_yaml(const SE3& body_from_sensor, const std::string& type) {
  std::ostringstream text;
  text << std::setprecision(17) << "sensor_type: " << type << "\nT_BS:\n  cols: 4\n  rows: 4\n  data: [";
  const Eigen::Matrix3d r = body_from_sensor.rotation_matrix();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) text << r(row, column) << ", ";
    text << body_from_sensor.translation()[row] << ",\n    ";
  }
  text << "0, 0, 0, 1]\n";
  return text.str();
}

class TruthFiles : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& content) {
    const auto path = directory_.path() / name;
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path) << content;
    return path;
  }
  /// EuRoC's data.csv of what `of` makes of each pose.
  std::filesystem::path write_euroc(const std::string& name, const std::function<SE3(const SE3&)>& of) {
    std::ostringstream text;
    text << std::setprecision(12) << "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], ...\n";
    for (int i = 0; i < kPoses; ++i) {
      const SE3 pose = of(pose_at(i));
      const auto& t = pose.translation();
      const auto& q = pose.rotation();
      text << kStart + i * kStep << ',' << t.x() << ',' << t.y() << ',' << t.z() << ',' << q.w() << ','
           << q.x() << ',' << q.y() << ',' << q.z() << ",0,0,0,0,0,0,0,0,0\n";
    }
    return write(name, text.str());
  }
  static void expect_cameras(const ReadTrajectory& read) {
    ASSERT_EQ(read.trajectory.pose_count(), static_cast<size_t>(kPoses));
    for (int i = 0; i < kPoses; ++i) {
      const auto& pose = read.trajectory.segments[0].poses[static_cast<size_t>(i)].map_from_camera;
      ASSERT_LT((pose.translation() - pose_at(i).translation()).norm(), 1e-9) << i;
      ASSERT_LT(pose.rotation().angularDistance(pose_at(i).rotation()), 1e-7) << i;
    }
  }
  static SE3 body(const SE3& world_from_camera) { return world_from_camera * kBodyFromCamera.inverse(); }

  static constexpr int kPoses = 200;
  TestDirectory directory_;
};

TEST_F(TruthFiles, EurocsFoldersTakeTheBodyToTheCamera) {
  const auto path = write_euroc("mav0/state_groundtruth_estimate0/data.csv", body);
  write("mav0/state_groundtruth_estimate0/sensor.yaml", sensor_yaml({}, "visual-inertial"));
  write("mav0/cam0/sensor.yaml", sensor_yaml(kBodyFromCamera, "camera"));
  const auto read = read_truth(path);
  ASSERT_TRUE(read) << read.error().message;
  expect_cameras(*read);
  EXPECT_THAT(read->notes, ElementsAre(HasSubstr("mav0/cam0/sensor.yaml")));
}

TEST_F(TruthFiles, ASensorYamlBesideIsTheCamerasOrThatOfWhatWasTracked) {
  const auto beside = write_euroc("flat/data.csv", body);
  write("flat/sensor.yaml", sensor_yaml(kBodyFromCamera, "camera"));
  const auto flat = read_truth(beside);
  ASSERT_TRUE(flat) << flat.error().message;
  expect_cameras(*flat);
  const auto vicon =
      write_euroc("mav0/vicon0/data.csv", [](const SE3& p) { return body(p) * kBodyFromMarker; });
  write("mav0/vicon0/sensor.yaml", sensor_yaml(kBodyFromMarker, "pose"));
  write("mav0/cam0/sensor.yaml", sensor_yaml(kBodyFromCamera, "camera"));
  const auto marker = read_truth(vicon);
  ASSERT_TRUE(marker) << marker.error().message;
  expect_cameras(*marker);
}

TEST_F(TruthFiles, WithoutASensorYamlTheBodyStaysAndIsSaid) {
  const auto read = read_truth(write_euroc("mocap0/data.csv", [](const SE3& pose) { return pose; }));
  ASSERT_TRUE(read) << read.error().message;
  expect_cameras(*read);
  EXPECT_THAT(read->notes, ElementsAre(HasSubstr("poses of the body, and no sensor.yaml")));
}

TEST_F(TruthFiles, TumRowsAreTheCamerasWhateverLiesBeside) {
  write("sensor.yaml", sensor_yaml(kBodyFromCamera, "camera"));
  const auto read =
      read_truth(write("groundtruth.txt", "1 1 2 3 0 0 0 1\n2 nan 2 3 0 0 0 1\n3 1 2 3 0 0 0 1\n"));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->trajectory.segments[0].poses[0].map_from_camera.translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_THAT(read->notes,
              ElementsAre(HasSubstr("groundtruth.txt: 1 row with NaN or a quaternion of zeros left out")));
}

TEST_F(TruthFiles, ABadSensorYamlIsNamed) {
  const auto path = write_euroc("data.csv", body);
  write("sensor.yaml",
        "sensor_type: camera\nT_BS:\n  data: [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n");
  const auto stretched = read_truth(path);
  ASSERT_FALSE(stretched);
  EXPECT_EQ(stretched.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(stretched.error().message, HasSubstr("sensor.yaml:3: T_BS is not a rotation"));
  write("sensor.yaml", "T_BS: {data: [1, 0]}\n");
  EXPECT_THAT(read_truth(path).error().message, HasSubstr("2 numbers, not 16"));
  write("sensor.yaml", "rate_hz: 20\n");
  EXPECT_TRUE(read_truth(path));
}

Eigen::Quaterniond w_to_the_front(const Eigen::Quaterniond& q) {
  return {q.z(), q.w(), q.x(), q.y()};  // x y z w are read of a file that has w x y z
}

Trajectory path_of(const std::function<SE3(int)>& pose) {
  Trajectory trajectory;
  auto& segment = trajectory.segments.emplace_back();
  for (int i = 0; i < 200; ++i) segment.poses.push_back({Timestamp{kStart + i * kStep}, pose(i)});
  return trajectory;
}

Comparison compared(const Trajectory& truth, const Trajectory& estimate) {
  const auto comparison = compare(truth, estimate, 0.02, Alignment::kSim3);
  EXPECT_TRUE(comparison);
  return *comparison;
}

SE3 misread(const SE3& pose) {
  return {w_to_the_front(pose.rotation()), pose.translation()};
}

/// An estimate in another world, of another frame of the same body, half a degree off.
SE3 estimated(int i) {
  const SE3 world(so3_exp(Eigen::Vector3d(0.3, 1.1, -0.7)), Eigen::Vector3d(4, -2, 7));
  const SE3 noise(so3_exp(0.008 * Eigen::Vector3d(std::sin(7.0 * i), std::cos(5.0 * i), 0.5)),
                  Eigen::Vector3d(0, 0, 0));
  return world * pose_at(i) * noise * kBodyFromCamera;
}

TEST(QuaternionOrder, WFirstIsSuspectedInTheFileThatHasIt) {
  const auto in_truth =
      doubt_quaternions(compared(path_of([](int i) { return misread(pose_at(i)); }), path_of(estimated)));
  ASSERT_TRUE(in_truth);
  EXPECT_TRUE(in_truth->in_truth);
  EXPECT_LT(in_truth->w_first, 0.02);
  EXPECT_GT(in_truth->as_read, 0.1);
  const auto in_estimate =
      doubt_quaternions(compared(path_of(pose_at), path_of([](int i) { return misread(estimated(i)); })));
  ASSERT_TRUE(in_estimate);
  EXPECT_FALSE(in_estimate->in_truth);
  const auto words = words_of(*in_truth, "truth.txt");
  EXPECT_THAT(words, HasSubstr("truth.txt: its quaternions probably have w first"));
  EXPECT_THAT(words, HasSubstr("print $1,$2,$3,$4,$6,$7,$8,$5}' truth.txt > NEW"));
}

TEST(QuaternionOrder, NothingIsSuspectedOfRightOrNoisyOrStillFiles) {
  EXPECT_FALSE(doubt_quaternions(compared(path_of(pose_at), path_of(estimated))));
  const auto shaken = [](int i) {
    const Eigen::Vector3d noise(std::sin(91.0 * i), std::cos(57.0 * i), std::sin(33.0 * i + 1));
    return SE3(so3_exp(0.4 * noise), Eigen::Vector3d::Zero());
  };
  EXPECT_FALSE(doubt_quaternions(compared(path_of(pose_at), path_of([&](int i) {
                                            return SE3(pose_at(i).rotation() * shaken(i).rotation(),
                                                       pose_at(i).translation());
                                          }))));
  const auto still = [](int i) {
    return SE3(Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5), pose_at(i).translation());
  };
  EXPECT_FALSE(doubt_quaternions(compared(path_of(still), path_of(still))));
}

}  // namespace
}  // namespace cairn
