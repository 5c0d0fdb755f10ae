// SPDX-License-Identifier: Apache-2.0
//
// cairn-micro: what the server does for each keyframe, one thread. Yardsticks: a copy of the image
// (micro.cpp), OpenCV's matcher of descriptors, Ceres with automatic derivatives.
#include <benchmark/benchmark.h>
#include <ceres/ceres.h>

#include <array>
#include <chrono>
#include <cmath>
#include <deque>
#include <memory>
#include <opencv2/features2d.hpp>
#include <vector>

#include "common/bundle/bundle_scene.h"
#include "common/image/descriptor.h"
#include "common/image/place.h"
#include "server/mapping/bundle_ceres.h"
#include "server/mapping/map_maker_fixture.h"
#include "server/mapping/map_record.h"
#include "server/relocalization/indexed_keyframe.h"
#include "tests/bench/timing.h"
#include "tests/world/simulator.h"

namespace cairn {
namespace {

// ---- New points of a keyframe

/// A map of the scene of two planes, 400 x 300, with eight keyframes, and the offer of a ninth.
struct GrowingMap {
  GrowingMap() : scene(11) {
    SeedInput input;
    input.map_name = "two planes";
    input.epoch = Epoch{1};
    input.camera = scene.camera();
    input.first_image = scene.render(testing::Scene::pose(0), 0);
    input.second_image = scene.render(testing::Scene::pose(testing::kSecondStep), testing::kSecondStep);
    input.trails = testing::make_trails(scene, *input.first_image, testing::Scene::pose(0),
                                        testing::Scene::pose(testing::kSecondStep));
    input.second_from_first = testing::motion_between(
        input, testing::Scene::pose(testing::kSecondStep) * testing::Scene::pose(0).inverse());
    auto maker = std::move(MapMaker::start(input, {}).value().first);
    int step = testing::kSecondStep;
    while (maker->statistics().keyframes < kKeyframes) {
      step += kStepsApart;
      static_cast<void>(maker->add_keyframe(testing::make_offer(scene, *maker->snapshot(), step)));
      while (maker->step(testing::kNeverYield).work != MapWork::kNone) {
      }
    }
    offer = testing::make_offer(scene, *maker->snapshot(), step + kStepsApart);
    record = maker->take_changes();
  }
  static constexpr size_t kKeyframes = 8;
  static constexpr int kStepsApart = 3;
  testing::Scene scene;
  MapRecord record;
  KeyframeInput offer;
};

/// Candidates of all levels, their search along epipolar lines, triangulation, confirmation.
void BM_NewPointsOfAKeyframe(benchmark::State& state) {
  const GrowingMap map;
  size_t made = 0;
  for (auto _ : state) {
    const auto restored = MapMaker::restore(map.record, {{}, "again", Epoch{2}}, {});
    if (!restored) return state.SkipWithError(restored.error().message.c_str());
    MapMaker& maker = *restored->maker;
    const auto decision = maker.add_keyframe(map.offer);
    if (decision.verdict != KeyframeVerdict::kAccepted) return state.SkipWithError(decision.reason.c_str());
    const size_t before = maker.statistics().points;
    double ms = 0;
    for (bool is_made = false; !is_made;) {
      const double began = thread_cpu_ms();
      const StepReport report = maker.step(testing::kNeverYield);
      if (report.work == MapWork::kNewPoints) ms += thread_cpu_ms() - began;
      is_made = report.work == MapWork::kNone || (report.work == MapWork::kNewPoints && report.finished);
    }
    state.SetIterationTime(ms * 1e-3);
    made = maker.statistics().points - before;
  }
  state.counters["made"] = static_cast<double>(made);
}
BENCHMARK(BM_NewPointsOfAKeyframe)->UseManualTime()->Unit(benchmark::kMillisecond);

// ---- Descriptors

/// A frame of the simulated desk.
Pyramid pyramid_of(int frame) {
  Pyramid pyramid;
  pyramid.build(Simulator::make("desk", {}).value().frame(frame).image.view());
  return pyramid;
}

std::vector<PlaceCorner> corners_of(const Pyramid& pyramid) {
  std::array<CornerList, kPyramidLevels> corners;
  for (size_t l = 0; l < corners.size(); ++l)
    detect_fast10(pyramid.level(static_cast<int>(l)), 10, &corners[l]);
  return describe_place(pyramid, corners).corners;
}

std::vector<Descriptor> descriptors_of(int frame) {
  std::vector<Descriptor> descriptors;
  for (const PlaceCorner& corner : corners_of(pyramid_of(frame))) descriptors.push_back(corner.descriptor);
  return descriptors;
}

/// A keyframe that measured 500 points or so.
KeyframeView measured_view() {
  KeyframeView view;
  view.id = KeyframeId{1};
  auto pyramid = std::make_shared<Pyramid>(pyramid_of(40));
  uint64_t number = 0;
  for (const PlaceCorner& corner : corners_of(*pyramid)) {
    if (++number % 7 < 4) view.measurements.push_back({PointId{number}, corner.level, corner.pixel});
  }
  view.pyramid = std::move(pyramid);
  return view;
}

/// Described at two exposures, eight scales in all.
void BM_IndexKeyframe(benchmark::State& state) {
  const KeyframeView view = measured_view();
  for (auto _ : state) benchmark::DoNotOptimize(index_keyframe(view));
  state.counters["points"] = static_cast<double>(view.measurements.size());
}
BENCHMARK(BM_IndexKeyframe)->Unit(benchmark::kMicrosecond);

/// Indexes a keyframe again with as many new points as most have that are indexed again while a map grows
/// (7scenes: 4).
void BM_IndexKeyframeAgain(benchmark::State& state) {
  const KeyframeView view = measured_view();
  KeyframeView before = view;
  before.measurements.resize(view.measurements.size() - 4);
  const auto indexed = index_keyframe(before);
  for (auto _ : state) benchmark::DoNotOptimize(index_keyframe(view, indexed.get()));
}
BENCHMARK(BM_IndexKeyframeAgain)->Unit(benchmark::kMicrosecond);

/// Seeks each corner of an image in all of another: the relocalizer looks only in the cells around.
void BM_FindNearestFew(benchmark::State& state) {
  constexpr int kLimit = 115;
  constexpr float kRatio = 0.9F;
  const auto queries = descriptors_of(40);
  const auto set = descriptors_of(45);
  const std::array<IndexRange, 1> all = {IndexRange{0, static_cast<uint32_t>(set.size())}};
  std::vector<NearDescriptor> found;
  for (auto _ : state) {
    found.clear();
    for (const Descriptor& query : queries) find_nearest_few(query, set, all, kLimit, kRatio, &found);
    benchmark::DoNotOptimize(found.data());
  }
  state.counters["queries"] = static_cast<double>(queries.size());
}
BENCHMARK(BM_FindNearestFew)->Unit(benchmark::kMicrosecond);

void BM_TwoNearestOfOpenCv(benchmark::State& state) {
  cv::setNumThreads(1);
  auto queries = descriptors_of(40);
  auto set = descriptors_of(45);
  const auto as_mat = [](std::vector<Descriptor>& rows) {
    return cv::Mat(static_cast<int>(rows.size()), static_cast<int>(sizeof(Descriptor)), CV_8UC1, rows.data());
  };
  const cv::BFMatcher matcher(cv::NORM_HAMMING);
  std::vector<std::vector<cv::DMatch>> matches;
  for (auto _ : state) matcher.knnMatch(as_mat(queries), as_mat(set), matches, 2);
}
BENCHMARK(BM_TwoNearestOfOpenCv)->Unit(benchmark::kMicrosecond);

// ---- One step of bundle adjustment

/// Twenty keyframes, 2000 points, each seen by half of those near it.
BundleProblem walk() {
  testing::Random random(1);
  BundleProblem problem = testing::noisy_walk(20, 2000, &random);
  testing::perturb(&problem, &random);
  return problem;
}

BundleOptions one_step() {
  BundleOptions options;
  options.max_iterations = 1;
  return options;
}

void report(benchmark::State& state, const BundleProblem& problem, double cost) {
  state.counters["observations"] = static_cast<double>(problem.observations.size());
  state.counters["cost"] = cost;
}

void BM_BundleStep(benchmark::State& state) {
  const BundleProblem start = walk();
  double cost = 0;
  for (auto _ : state) {
    BundleProblem problem = start;
    cost = solve_bundle(&problem, one_step()).final_cost;
  }
  report(state, start, cost);
}
BENCHMARK(BM_BundleStep)->Unit(benchmark::kMillisecond);

void BM_BundleStepOfCeres(benchmark::State& state) {
  const BundleProblem start = walk();
  double cost = 0;
  for (auto _ : state) {
    BundleProblem problem = start;
    cost = solve_bundle_with_ceres(&problem, one_step(), {.linear_solver = ceres::DENSE_SCHUR}).final_cost;
  }
  report(state, start, cost);
}
BENCHMARK(BM_BundleStepOfCeres)->Unit(benchmark::kMillisecond);

/// ReprojectionCost as one writes it who leaves the derivatives to Ceres; of a pinhole camera with radial and
/// tangential distortion. Every point of walk() projects.
struct AutomaticCost {
  template <typename T>
  bool operator()(const T* pose, const T* point, T* residual) const {
    const Eigen::Map<const Eigen::Quaternion<T>> rotation(pose + 3);
    const Eigen::Matrix<T, 3, 1> p = rotation * Eigen::Map<const Eigen::Matrix<T, 3, 1>>(point) +
                                     Eigen::Map<const Eigen::Matrix<T, 3, 1>>(pose);
    const T x = p.x() / p.z();
    const T y = p.y() / p.z();
    const T u = x * x + y * y;
    const std::vector<double>& v = *values;
    const T radial = 1.0 + u * (v[4] + u * v[5]);
    const T dx = x * radial + 2.0 * v[6] * x * y + v[7] * (u + 2.0 * x * x);
    const T dy = y * radial + v[6] * (u + 2.0 * y * y) + 2.0 * v[7] * x * y;
    residual[0] = inverse_sigma * (v[0] * dx + v[2] - pixel.x());
    residual[1] = inverse_sigma * (v[1] * dy + v[3] - pixel.y());
    return true;
  }
  const std::vector<double>* values;
  Eigen::Vector2d pixel;
  double inverse_sigma;
};

/// Solves a problem as solve_bundle_with_ceres() does, but with automatic derivatives. `squared_cutoff` of
/// Tukey's loss. Returns the cost in the end.
double step_with_automatic_derivatives(BundleProblem* bundle, double squared_cutoff) {
  std::vector<std::array<double, kPoseParameters>> poses(bundle->poses.size());
  for (size_t i = 0; i < poses.size(); ++i)
    pose_to_parameters(bundle->poses[i].camera_from_map, poses[i].data());
  ceres::Problem::Options owned;
  owned.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  owned.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  owned.disable_all_safety_checks = true;
  ceres::TukeyLoss loss(std::sqrt(squared_cutoff));
  ceres::ProductManifold<ceres::EuclideanManifold<3>, ceres::EigenQuaternionManifold> manifold;
  ceres::Problem problem(owned);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const BundleObservation& o : bundle->observations) {
    const auto pose = static_cast<size_t>(o.pose);
    double* const point = bundle->points[static_cast<size_t>(o.point)].data();
    using Cost = ceres::AutoDiffCostFunction<AutomaticCost, 2, kPoseParameters, 3>;
    auto cost = std::make_unique<Cost>(
        new AutomaticCost{&bundle->poses[pose].camera->parameters().values, o.pixel, o.inverse_sigma});
    problem.AddResidualBlock(cost.release(), &loss, poses[pose].data(), point);
    ordering->AddElementToGroup(point, 0);
  }
  for (size_t i = 0; i < poses.size(); ++i) {
    problem.SetManifold(poses[i].data(), &manifold);
    ordering->AddElementToGroup(poses[i].data(), 1);
    if (bundle->poses[i].fixed) problem.SetParameterBlockConstant(poses[i].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_ordering = ordering;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 1;
  options.num_threads = 1;
  options.max_trust_region_radius = 1e8;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.final_cost;
}

void BM_BundleStepOfCeresWithAutomaticDerivatives(benchmark::State& state) {
  const BundleProblem start = walk();
  BundleProblem same = start;
  const double squared_cutoff = solve_bundle(&same, one_step()).squared_cutoff;
  double cost = 0;
  for (auto _ : state) {
    BundleProblem problem = start;
    cost = step_with_automatic_derivatives(&problem, squared_cutoff);
  }
  report(state, start, cost);
}
BENCHMARK(BM_BundleStepOfCeresWithAutomaticDerivatives)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace cairn
