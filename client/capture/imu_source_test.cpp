// SPDX-License-Identifier: Apache-2.0
#include "client/capture/imu_source.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "client/capture/imu_file.h"
#include "client/capture/source_files_fixture.h"
#include "common/geometry/se3.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr const char* kEurocHeading =
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y "
    "[m s^-2],a_RS_S_z [m s^-2]\n";
constexpr int64_t kBegin = 1'403'715'273'000'000'000;

class ImuFiles : public FrameSourceFiles {
 protected:
  /// 200 samples a second: rates 0.1 0.2 0.3, up along z.
  static std::string euroc_rows(int count = 100, int64_t begin = kBegin) {
    std::string rows = kEurocHeading;
    for (int i = 0; i < count; ++i)
      rows += fmt::format("{},0.1,0.2,0.3,0.5,0.25,9.8\n", begin + 5'000'000 * i);
    return rows;
  }
  void write_euroc(const std::string& imu) {
    write_image("mav0/cam0/data/1.png", 0);
    write_image("mav0/cam0/data/2.png", 1);
    write_text("mav0/cam0/data.csv", fmt::format("#timestamp [ns],filename\n{},1.png\n{},2.png\n",
                                                 kBegin + 50'000'000, kBegin + 100'000'000));
    // The camera is turned by a quarter about z of the body.
    write_text(
        "mav0/cam0/sensor.yaml",
        "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0, -1, 0, 0.1, 1, 0, 0, 0, 0, 0, 1, 0, "
        "0, 0, 0, 1]\n");
    fs::create_directories(dir() / "mav0/imu0");
    write_text("mav0/imu0/data.csv", imu);
    write_text("mav0/imu0/sensor.yaml",
               "sensor_type: imu\nT_BS:\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n");
  }
  void write_tum() {
    write_image("1.png", 0);
    write_text("rgb.txt", fmt::format("{}.05 1.png\n", kBegin / 1'000'000'000));
  }
  Result<OpenedImu> open(const std::string& text, const ImuRequest& request = {}) const {
    const auto source = open_source(text);
    EXPECT_TRUE(source) << source.error().message;
    return open_imu(text, **source, request);
  }
  Error file_error(const std::string& content) {
    write_text("imu.csv", content);
    const auto read = read_imu_file(dir() / "imu.csv");
    return read ? Error{} : read.error();
  }
};

TEST_F(ImuFiles, ColumnsAreToldByTheHeadingOrByGravity) {
  const std::string_view rows = "1.000 0.5 0.25 9.8 0.1 0.2 0.3\n1.005 0.5 0.25 9.8 0.1 0.2 0.3\n";
  for (const std::string& content :
       {euroc_rows(2, 1'000'000'000'000'000'000), std::string(rows),
        "# timestamp ax ay az gx gy gz\n" + std::string(rows),
        std::string(
            "timestamp,ax,ay,az,gx,gy,gz\n1.000,0.5,0.25,9.8,0.1,0.2,0.3\n1.005,0.5,0.25,9.8,0.1,0.2,0.3\n"),
        std::string("1520621175986840704 0.1 0.2 0.3 0.5 0.25 9.8\n1520621175991840704 0.1 0.2 0.3 0.5 0.25 "
                    "9.8\n")}) {
    write_text("imu.csv", content);
    const auto samples = read_imu_file(dir() / "imu.csv");
    ASSERT_TRUE(samples) << samples.error().message << content;
    ASSERT_EQ(samples->size(), 2U);
    EXPECT_EQ((*samples)[1].time - (*samples)[0].time, std::chrono::milliseconds(5));
    EXPECT_TRUE((*samples)[1].rate.isApprox(Eigen::Vector3d(0.1, 0.2, 0.3)));
    EXPECT_TRUE((*samples)[1].acceleration.isApprox(Eigen::Vector3d(0.5, 0.25, 9.8)));
  }
}

TEST_F(ImuFiles, BadRowsAndUnitsAreNamed) {
  EXPECT_THAT(file_error("1.0 0 0 0 0 0 9.8\n1.005 0 0 0 0 9.8\n").message,
              HasSubstr("imu.csv:2: not a row `time wx wy wz ax ay az`"));
  EXPECT_THAT(file_error("1.0 0 0 0 0 0 9.8\n1.005 0 0 0 0 0 nan\n").message,
              HasSubstr("imu.csv:2: not a row"));
  EXPECT_THAT(file_error("1.0 0 0 0 0 0 9.8\n0.9 0 0 0 0 0 9.8\n").message,
              HasSubstr("imu.csv:2: time goes back"));
  EXPECT_THAT(file_error("").message, HasSubstr("has no rows"));
  EXPECT_THAT(file_error("1.0 0 0 0 0 0 1\n1.005 0 0 0 0 0 1\n").message,
              AllOf(HasSubstr("no gravity"), HasSubstr("rad/s and m/s^2")));
  EXPECT_THAT(file_error("# time gx gy gz ax ay az\n1.0 0 0 0 0 0 1\n1.005 0 0 0 0 0 1\n").message,
              HasSubstr("they are in g, it seems"));
  EXPECT_THAT(file_error("1.0 20 0 0 0 0 9.8\n1.005 30 0 0 0 0 9.8\n").message,
              HasSubstr("degrees a second, it seems"));
  EXPECT_THAT(file_error("1.0 0 0 0 0 0 9.8\n1.1 0 0 0 0 0 9.8\n").message, HasSubstr("20 a second or more"));
  EXPECT_EQ(file_error("1.0 0 0 0 0 0 9.8\n1.1 0 0 0 0 0 9.8\n").code, ErrorCode::kDamaged);
}

/// A heading's first letter is not its word, and a word that says nothing leaves it to gravity.
TEST_F(ImuFiles, HeadingsAreReadAsWords) {
  const std::string rates_first = "1.000,0.1,0.2,0.3,0.5,0.25,9.8\n1.005,0.1,0.2,0.3,0.5,0.25,9.8\n";
  for (const char* heading :
       {"timestamp,angular_velocity_x,angular_velocity_y,angular_velocity_z,linear_acceleration_x,a_y,a_z\n",
        "timestamp,alpha,beta,gamma,ax,ay,az\n", "t,gyro.x,gyro.y,gyro.z,accel.x,accel.y,accel.z\n",
        "\"t\",\"omega_x\",\"omega_y\",\"omega_z\",\"ax\",\"ay\",\"az\"\n"}) {
    write_text("imu.csv", heading + rates_first);
    const auto samples = read_imu_file(dir() / "imu.csv");
    ASSERT_TRUE(samples) << heading << samples.error().message;
    EXPECT_TRUE((*samples)[0].rate.isApprox(Eigen::Vector3d(0.1, 0.2, 0.3))) << heading;
  }
  write_text("imu.csv",
             "t,Accel_x,Accel_y,Accel_z,Gyro_x,Gyro_y,Gyro_z\n1.000,0,0,9.8,0,9.8,0\n1.005,0,0,9.8,0,1,"
             "0\n1.010,0,0,9.8,0,1,0\n");
  const auto samples = read_imu_file(dir() / "imu.csv");
  ASSERT_TRUE(samples) << samples.error().message;
  EXPECT_EQ((*samples)[0].acceleration, Eigen::Vector3d(0, 0, 9.8));
}

TEST_F(ImuFiles, TimesThatAreNoneAreNamed) {
  EXPECT_THAT(file_error("9223372036854775807,0,0,0,0,0,9.8\n9223372036854775807,0,0,0,0,0,9.8\n").message,
              HasSubstr("imu.csv:1: its time is more than 146 years from 1970"));
  EXPECT_THAT(file_error("1520621175986.84,0,0,0,0,0,9.8\n").message, HasSubstr("146 years"));
  // Microseconds of 16 digits.
  EXPECT_THAT(file_error("1520621175986840,0,0,0,0,0,9.8\n1520621175991840,0,0,0,0,0,9.8\n").message,
              HasSubstr("a sample every 5e-06 s, which is no IMU's"));
}

/// A camera that sits as the body does, by the sensor.yaml of an IMU: nobody would notice.
TEST_F(ImuFiles, AMountOfAnotherSensorIsRefused) {
  write_euroc(euroc_rows());
  const auto of_imu = open(uri("euroc"), {{}, (dir() / "mav0/imu0/sensor.yaml").string(), {}});
  ASSERT_FALSE(of_imu);
  EXPECT_EQ(of_imu.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(of_imu.error().message, AllOf(HasSubstr("imu0/sensor.yaml: is of a sensor of the type 'imu'"),
                                            HasSubstr("--imu-mount")));
  write_text("mav0/cam0/imu.csv", euroc_rows());
  EXPECT_THAT(open(uri("euroc"), {dir() / "mav0/cam0/imu.csv", "", {}}).error().message,
              HasSubstr("cam0/sensor.yaml: is of a sensor of the type 'camera', where that of the imu"));
  write_text("mav0/cam0/sensor.yaml",
             "sensor_type: imu\nT_BS:\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n");
  const auto unasked = open(uri("euroc"));
  ASSERT_TRUE(unasked) << "what nobody asked for keeps no recording from being played";
  EXPECT_FALSE(unasked->stream);
  EXPECT_THAT(unasked->notes.at(0).text, HasSubstr("is of a sensor of the type 'imu'"));
  EXPECT_TRUE(unasked->notes.at(0).is_warning);
}

TEST_F(ImuFiles, EurocFindsItsSamplesAndHowTheySit) {
  write_euroc(euroc_rows());
  const auto opened = open(uri("euroc"));
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_TRUE(opened->stream);
  std::vector<ImuSample> samples;
  opened->stream->take(Timestamp{kBegin + 50'000'000}, &samples);
  EXPECT_EQ(samples.size(), 11U);
  const Eigen::Vector3d x = opened->stream->mount()->camera_from_imu * Eigen::Vector3d::UnitX();
  EXPECT_TRUE(x.isApprox(-Eigen::Vector3d::UnitY())) << x.transpose();
  EXPECT_THAT(opened->notes.at(0).text, HasSubstr("100 samples of an IMU, 200 a second"));
}

TEST_F(ImuFiles, SamplesWhoseMountIsNotSaidAreNotUsedAndRefusedWhenAskedFor) {
  write_tum();
  write_text("imu.csv", euroc_rows());
  const auto beside = open(uri("tum"));
  ASSERT_TRUE(beside) << beside.error().message;
  EXPECT_FALSE(beside->stream);
  EXPECT_THAT(beside->notes.at(0).text, AllOf(HasSubstr("is not used"), HasSubstr("--imu-mount")));
  const auto asked = open(uri("tum"), {dir() / "imu.csv", "", {}});
  ASSERT_FALSE(asked);
  EXPECT_EQ(asked.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(asked.error().message,
              HasSubstr("it is not known how this IMU sits to the camera; pass --imu-mount"));
  const auto told = open(uri("tum"), {{}, "0,0,0,1", std::chrono::milliseconds(3)});
  ASSERT_TRUE(told) << told.error().message;
  EXPECT_EQ(told->stream->mount()->clock_offset, std::chrono::milliseconds(3));
}

TEST_F(ImuFiles, KalibrsCamchainAndAFolderAreTaken) {
  write_tum();
  fs::create_directories(dir() / "imu0");
  write_text("imu0/data.csv", euroc_rows());
  write_text("camchain.yaml",
             "cam0:\n  T_cam_imu:\n  - [0, 1, 0, 0]\n  - [-1, 0, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n"
             "  timeshift_cam_imu: 0.002\n");
  const auto opened = open(uri("tum"), {dir() / "imu0", (dir() / "camchain.yaml").string(), {}});
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_EQ(opened->stream->mount()->clock_offset, std::chrono::milliseconds(-2));
  const Eigen::Vector3d x = opened->stream->mount()->camera_from_imu * Eigen::Vector3d::UnitX();
  EXPECT_TRUE(x.isApprox(-Eigen::Vector3d::UnitY()));
  write_text("camchain.yaml",
             "cam0:\n  T_cam_imu:\n  - [2, 0, 0, 0]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n");
  EXPECT_THAT(open(uri("tum"), {dir() / "imu0", (dir() / "camchain.yaml").string(), {}}).error().message,
              HasSubstr("T_cam_imu is not a rotation and a translation"));
  write_text("camchain.yaml",
             "cam0:\n  T_cam_imu:\n  - [1, 0, 0, 0]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n"
             "  timeshift_cam_imu: 1e30\n");
  EXPECT_THAT(open(uri("tum"), {dir() / "imu0", (dir() / "camchain.yaml").string(), {}}).error().message,
              HasSubstr("timeshift_cam_imu is not within"));
  write_text("camchain.yaml", "cam0: {}\n");
  EXPECT_THAT(open(uri("tum"), {dir() / "imu0", (dir() / "camchain.yaml").string(), {}}).error().message,
              HasSubstr("says not how the IMU sits"));
  EXPECT_EQ(open(uri("tum"), {dir() / "imu0", "none.yaml", {}}).error().code, ErrorCode::kConfiguration);
}

TEST_F(ImuFiles, SamplesOfAnotherTimeThanTheFramesAreRefused) {
  write_euroc(euroc_rows(100, kBegin + 60'000'000'000));
  const auto unasked = open(uri("euroc"));
  ASSERT_TRUE(unasked) << "what nobody asked for keeps no recording from being played";
  EXPECT_FALSE(unasked->stream);
  EXPECT_TRUE(unasked->notes.at(0).is_warning);
  const auto opened = open(uri("euroc"), {dir() / "mav0/imu0", "", {}});
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::kDamaged);
  EXPECT_THAT(opened.error().message,
              AllOf(HasSubstr("none goes with a frame"), HasSubstr("--imu-time-offset SECONDS")));
  EXPECT_TRUE(open(uri("euroc"), {{}, "", std::chrono::seconds(-60)}));
}

TEST_F(ImuFiles, WithoutSamplesThereIsNone) {
  write_tum();
  const auto opened = open(uri("tum"));
  ASSERT_TRUE(opened);
  EXPECT_FALSE(opened->stream);
  EXPECT_EQ(open(uri("tum"), {{}, "0,0,0,1", {}}).error().code, ErrorCode::kUsage);
  EXPECT_EQ(open(uri("tum"), {dir() / "gone.csv", "0,0,0,1", {}}).error().code, ErrorCode::kNotFound);
}

/// Real rows, where there are some: all of them, at the times and the rate that they were taken.
TEST(Recordings, TheRowsOfEurocsImuAreReadWhole) {
  const char* data = std::getenv("CAIRN_DATA");
  if (data == nullptr) GTEST_SKIP() << "CAIRN_DATA is not set";
  const std::filesystem::path folder = std::filesystem::path(data) / "euroc-v101-micro";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  const auto samples = read_imu_file(folder / "imu.csv");
  ASSERT_TRUE(samples) << samples.error().message;
  ASSERT_EQ(samples->size(), 791U);
  EXPECT_EQ(samples->front().time.nanoseconds, 1'403'715'273'262'142'976);
  EXPECT_EQ(samples->back().time.nanoseconds, 1'403'715'277'212'143'104);
  double pull = 0;
  for (size_t i = 1; i < samples->size(); ++i) {
    EXPECT_NEAR(seconds_between((*samples)[i].time, (*samples)[i - 1].time), 0.005, 1e-6) << i;
    pull += (*samples)[i].acceleration.norm() / 790;
  }
  EXPECT_NEAR(pull, 9.81, 0.3);
  const std::string uri = "tum:" + folder.string();
  const auto source = open_source(uri);
  ASSERT_TRUE(source) << source.error().message;
  const auto imu = open_imu(uri, **source, {{}, "0,0,0,1", {}});
  ASSERT_TRUE(imu) << imu.error().message;
  std::vector<ImuSample> taken;
  imu->stream->take(samples->back().time, &taken);
  EXPECT_EQ(taken.size(), samples->size());
}

}  // namespace
}  // namespace cairn
