// Joint steps of ViSP's own vpServo for many hands before fixed cameras: the program that visp_library.py compiles.
//
// Reads batches from standard input until it ends, and answers each on standard output; numbers as the machine holds
// them. A batch: int32 hands B, cameras c, points m of a camera, joints n, interaction matrix (0 current, 1 desired,
// 2 mean), 0; doubles gain at zero, gain at infinity, slope at zero (all of them for vpAdaptiveGain; a constant gain has
// the first two equal); then for each hand points (c m, 2), depths (c m), desired points (c m, 2), their depths (c m),
// cMe (c, 4, 4) row by row, eJe (6, n) row by row. Points are in ViSP's normalized coordinates, NaN where not seen.
// The answer: steps (B, n), zero for a hand without a point that is seen both now and as desired.

#include <cmath>
#include <cstdint>
#include <deque>
#include <exception>
#include <iostream>
#include <vector>

#include <visp3/core/vpConfig.h>
#include <visp3/core/vpHomogeneousMatrix.h>
#include <visp3/core/vpMatrix.h>
#include <visp3/core/vpVelocityTwistMatrix.h>
#include <visp3/visual_features/vpFeaturePoint.h>
#include <visp3/vs/vpAdaptiveGain.h>
#include <visp3/vs/vpServo.h>

// A point of a further camera, its interaction matrix expressed by the twist in the first one's frame: vpServo knows a
// single camera, and so stacks several.
class PointOfCamera : public vpFeaturePoint
{
public:
  explicit PointOfCamera(const vpVelocityTwistMatrix &to_own) : to_own_(to_own) {}
  vpMatrix interaction(unsigned int select = FEATURE_ALL)
  {
    return vpFeaturePoint::interaction(select) * to_own_;
  }

private:
  vpVelocityTwistMatrix to_own_;
};

struct Header {
  int32_t hands, cameras, points, joints, matrix, unused;
  double gain_at_zero, gain_at_infinity, slope_at_zero;
};

static vpHomogeneousMatrix pose_of(const double *rows)
{
  vpHomogeneousMatrix pose;
  for (unsigned int i = 0; i < 3; i++)
    for (unsigned int j = 0; j < 4; j++)
      pose[i][j] = rows[4 * i + j];
  return pose;
}

static void step_of(const Header &header, const double *in, double *out)
{
  const int count = header.cameras * header.points;
  const double *points = in, *depths = points + 2 * count, *desired = depths + count, *far = desired + 2 * count;
  const double *poses = far + count, *jacobian = poses + 16 * header.cameras;
  const vpHomogeneousMatrix first = pose_of(poses);

  vpServo task;
  task.setServo(vpServo::EYETOHAND_L_cVe_eJe);
  const vpServo::vpServoIteractionMatrixType kinds[] = {vpServo::CURRENT, vpServo::DESIRED, vpServo::MEAN};
  task.setInteractionMatrixType(kinds[header.matrix], vpServo::PSEUDO_INVERSE);
  if (header.gain_at_zero == header.gain_at_infinity)
    task.setLambda(header.gain_at_zero);
  else
    task.setLambda(vpAdaptiveGain(header.gain_at_zero, header.gain_at_infinity, header.slope_at_zero));

  std::deque<PointOfCamera> features; // a deque, as vpServo keeps addresses
  for (int camera = 0; camera < header.cameras; camera++) {
    const vpVelocityTwistMatrix to_own(pose_of(poses + 16 * camera) * first.inverse());
    for (int point = 0; point < header.points; point++) {
      const int k = camera * header.points + point;
      if (std::isnan(points[2 * k]) || std::isnan(desired[2 * k]))
        continue;
      features.emplace_back(to_own);
      features.back().buildFrom(points[2 * k], points[2 * k + 1], depths[k]);
      vpFeaturePoint &now = features.back();
      features.emplace_back(to_own);
      features.back().buildFrom(desired[2 * k], desired[2 * k + 1], far[k]);
      task.addFeature(now, features.back());
    }
  }
  for (int joint = 0; joint < header.joints; joint++)
    out[joint] = 0.0;
  if (features.empty())
    return;
  vpMatrix eJe(6, header.joints);
  for (int i = 0; i < 6; i++)
    for (int joint = 0; joint < header.joints; joint++)
      eJe[i][joint] = jacobian[i * header.joints + joint];
  task.set_cVe(vpVelocityTwistMatrix(first));
  task.set_eJe(eJe);
  const vpColVector step = task.computeControlLaw();
  for (int joint = 0; joint < header.joints; joint++)
    out[joint] = step[joint];
}

int main(int argc, char **)
{
  if (argc > 1) { // any argument: the version
    std::cout << VISP_VERSION_MAJOR << "." << VISP_VERSION_MINOR << "." << VISP_VERSION_PATCH << std::endl;
    return 0;
  }
  try {
    Header header;
    while (std::cin.read(reinterpret_cast<char *>(&header), sizeof header)) {
      const size_t each = 6 * header.cameras * header.points + 16 * header.cameras + 6 * header.joints;
      std::vector<double> in(each * header.hands), out(static_cast<size_t>(header.joints) * header.hands);
      if (!std::cin.read(reinterpret_cast<char *>(in.data()), in.size() * sizeof(double)))
        return 2;
      for (int hand = 0; hand < header.hands; hand++)
        step_of(header, in.data() + each * hand, out.data() + static_cast<size_t>(header.joints) * hand);
      std::cout.write(reinterpret_cast<const char *>(out.data()), out.size() * sizeof(double));
      std::cout.flush();
    }
  } catch (const std::exception &error) {
    std::cerr << error.what() << std::endl;
    return 1;
  }
  return 0;
}
