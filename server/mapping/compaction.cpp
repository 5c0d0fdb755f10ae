// SPDX-License-Identifier: Apache-2.0
#include <utility>

#include "server/mapping/map_state.h"

namespace cairn {
namespace {

/// Gives numbers from 1 to those that live, in their order.
template <typename Id, typename Item>
std::vector<Id> number_anew(const std::vector<Item>& items) {
  std::vector<Id> numbers(items.size());
  uint64_t next = 0;
  for (size_t i = 0; i < items.size(); ++i) {
    if (items[i].live) numbers[i] = Id{++next};
  }
  return numbers;
}

/// The first keyframe that lives among those whose corrections one rides on: what has been removed rides on
/// the next itself.
KeyframeId living_reference(const std::vector<MapKeyframe>& keyframes, KeyframeId reference) {
  while (reference && !keyframes[reference.value - 1].live)
    reference = keyframes[reference.value - 1].reference;
  return reference;
}

template <typename Item>
void drop_dead(std::vector<Item>* items) {
  std::erase_if(*items, [](const Item& item) { return !item.live; });
  items->shrink_to_fit();
}

}  // namespace

Renumbering MapState::compact() {
  // How many keyframes a camera had when it was judged counts those that go, too.
  for (const MapKeyframe& k : keyframes_) {
    if (k.live || k.estimated_camera < 0) continue;
    size_t& judged = cameras_[static_cast<size_t>(k.estimated_camera)].judged_keyframes;
    if (judged > 0) --judged;
  }
  const Renumbering now{number_anew<KeyframeId>(keyframes_), number_anew<PointId>(points_)};
  for (MapKeyframe& k : keyframes_) {
    if (!k.live) continue;
    k.reference = living_reference(keyframes_, k.reference);
  }
  for (MapKeyframe& k : keyframes_) {
    if (!k.live) continue;
    k.id = now.of(k.id);
    k.reference = now.of(k.reference);
    for (Measurement& m : k.measurements) m.point = now.of(m.point);
    for (PointId& id : k.given_up) id = now.of(id);
  }
  for (MapPoint& p : points_) {
    if (!p.live) continue;
    p.id = now.of(p.id);
    PointSource source = *p.source;
    source.id = p.id;
    source.keyframe = now.of(source.keyframe);
    p.source = std::make_shared<const PointSource>(source);
    for (KeyframeId& id : p.observers) id = now.of(id);
  }
  drop_dead(&keyframes_);
  drop_dead(&points_);
  for (PointId& id : live_points_) id = now.of(id);
  return now;
}

}  // namespace cairn
