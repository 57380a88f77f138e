// The contact solver against independent solvers and against the conditions that define its solution.
#include <BulletDynamics/MLCPSolvers/btDantzigSolver.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <cmath>

#include "phri_core/random.hpp"
#include "phri_sim/contact_solver.hpp"

namespace
{
using namespace phri_sim;
using Eigen::Vector3d;

constexpr double kSolved = 1e-7;   // residual of a converged solution over the largest velocity
constexpr double kCrawled = 1e-6;  // of the velocities: what 200000 sweeps leave

/// Random contacts between bodies: A = J J^T with fewer columns than rows, as real trees have.
struct Problem
{
  Eigen::MatrixXd delassus;
  Eigen::VectorXd velocity;
  std::vector<CompliantContact> contacts;
};

Problem randomProblem(phri_core::Random& random, int contacts, double friction)
{
  const int size = friction > 0.0 ? 3 : 1;
  Eigen::MatrixXd jacobian(size * contacts, 8);
  for (Eigen::Index i = 0; i < jacobian.size(); ++i)
    jacobian.data()[i] = random.normal();
  Problem p;
  p.delassus = jacobian * jacobian.transpose() * std::pow(10.0, -2.0 + 3.0 * random.uniform());  // masses 0.01 .. 10 kg
  p.velocity.resize(size * contacts);
  for (double& v : p.velocity)
    v = 0.3 * random.normal();
  for (int i = 0; size == 3 && i < contacts; ++i)  // slow along the surface as often as fast, for sticking
    p.velocity.segment<2>(3 * i + 1) *= random.uniform() < 0.5 ? 0.03 : 1.0;
  for (int i = 0; i < contacts; ++i)
    p.contacts.push_back({ size * i, 1e-3 * random.normal(), std::pow(10.0, 3.0 + 1.7 * random.uniform()), 1.0,
                           random.uniform(), friction });
  return p;
}

constexpr double kStep = 1e-3;

/// Softness and bias of a normal row, written from the header's equations once more.
void normalRow(const Problem& p, const CompliantContact& c, double& bias, double& softness)
{
  const double stiffness = c.share * c.stiffness;
  const double damping =
      c.distance > 0.0 ? 0.0 : c.share * 2.0 * c.damping_ratio * std::sqrt(c.stiffness / p.delassus(c.row, c.row));
  bias = c.distance * stiffness / (kStep * stiffness + damping);
  softness = 1.0 / (kStep * (kStep * stiffness + damping));
}

TEST(ContactSolver, AgreesWithDantzigsPivotingWithoutFriction)
{
  phri_core::Random random(11);
  int pressing = 0;
  for (int trial = 0; trial < 200; ++trial)
  {
    const Problem p = randomProblem(random, 6, 0.0);
    Eigen::VectorXd impulses(6);
    ContactSolver solver(6);
    ASSERT_LE(solver.solve(kStep, p.delassus, p.contacts, p.velocity, impulses), ContactSolver::kMaxSweeps);

    btMatrixXd matrix(6, 6);
    btVectorXd right(6), solution(6), low(6), high(6);
    btAlignedObjectArray<int> dependency;
    for (int i = 0; i < 6; ++i)
    {
      double bias, softness;
      normalRow(p, p.contacts[std::size_t(i)], bias, softness);
      for (int j = 0; j < 6; ++j)
        matrix.setElem(i, j, p.delassus(i, j) + (i == j ? softness : 0.0));
      right[i] = -p.velocity(i) - bias;
      solution[i] = low[i] = 0.0;
      high[i] = 1e6;
      dependency.push_back(-1);
    }
    btDantzigSolver dantzig;
    ASSERT_TRUE(dantzig.solveMLCP(matrix, right, solution, low, high, dependency, 0));
    for (int i = 0; i < 6; ++i)
    {
      EXPECT_NEAR(impulses(i), solution[i], 1e-7 * (1.0 + impulses.maxCoeff()));
      pressing += impulses(i) > 0.0;
    }
  }
  EXPECT_GT(pressing, 200);
}

struct Met
{
  int sticking = 0, sliding = 0, apart = 0, unconverged = 0;
};

/// Solves it and holds the solution against the conditions in the header.
void expectConditions(const Problem& p, Met& met)
{
  Eigen::VectorXd impulses(p.velocity.size());
  ContactSolver solver(int(p.velocity.size()));
  const int sweeps = solver.solve(kStep, p.delassus, p.contacts, p.velocity, impulses);
  const bool unconverged = sweeps > ContactSolver::kMaxSweeps;
  met.unconverged += unconverged;
  const Eigen::VectorXd after = p.velocity + p.delassus * impulses;
  const double scale = p.velocity.cwiseAbs().maxCoeff() + 1.0;
  for (const CompliantContact& c : p.contacts)
  {
    double bias, softness;
    normalRow(p, c, bias, softness);
    const double w = after(c.row) + bias + softness * impulses(c.row);
    const Eigen::Vector2d t = impulses.segment<2>(c.row + 1);
    const double creep = ContactSolver::kCreep * p.delassus.block<2, 2>(c.row + 1, c.row + 1).trace();
    const Eigen::Vector2d slip = after.segment<2>(c.row + 1) + creep * t;
    const double limit = c.friction * impulses(c.row);
    EXPECT_GE(impulses(c.row), 0.0);
    EXPECT_LE(t.norm(), limit * (1.0 + 1e-12));
    if (unconverged)
      continue;
    EXPECT_GT(w, -kSolved * scale);
    EXPECT_LT(std::abs(w * impulses(c.row)), kSolved * scale);
    if (impulses(c.row) == 0.0)
      ++met.apart;
    else if (t.norm() < limit * (1.0 - 1e-6))
    {
      ++met.sticking;
      EXPECT_LT(slip.norm(), kSolved * scale);
    }
    else
    {
      ++met.sliding;
      EXPECT_LT(slip.dot(t), -(1.0 - 1e-6) * slip.norm() * t.norm() + kSolved * scale * t.norm());
    }
  }
}

/// The face of a box on a face, a quarter of the stiffness at each corner: 12 rows of rank 6. The body's apparent
/// inverse inertia is that at an arm's tip: eigenvalues over 2 decades each way, in any directions.
Problem randomPatches(phri_core::Random& random, int patches)
{
  const auto gaussian = [&](Eigen::Index rows, Eigen::Index columns) {
    Eigen::MatrixXd m(rows, columns);
    for (Eigen::Index i = 0; i < m.size(); ++i)
      m.data()[i] = random.normal();
    return m;
  };
  const Eigen::MatrixXd axes = Eigen::HouseholderQR<Eigen::MatrixXd>(gaussian(6, 6)).householderQ();
  Eigen::VectorXd inverse(6);
  for (double& value : inverse)
    value = std::pow(10.0, -2.0 + 3.0 * random.uniform());
  Problem p;
  Eigen::MatrixXd jacobian(12 * patches, 6);
  for (int patch = 0; patch < patches; ++patch)
  {
    const Eigen::Matrix3d turn = Eigen::HouseholderQR<Eigen::MatrixXd>(gaussian(3, 3)).householderQ();
    const Vector3d centre = 0.3 * gaussian(3, 1);
    const double length = 0.02 + 0.5 * random.uniform(), width = 0.01 + 0.1 * random.uniform();
    const double depth = 2e-3 * random.uniform(), tilt = random.uniform() < 0.5 ? 0.0 : 1e-3 * random.normal();
    const double stiffness = std::pow(10.0, 3.3 + 1.7 * random.uniform()), ratio = random.uniform();
    const double friction = std::pow(10.0, -1.3 + 1.2 * random.uniform());
    for (int corner = 0; corner < 4; ++corner)
    {
      const double side = corner & 1 ? 0.5 : -0.5;
      const Vector3d point = centre + turn * Vector3d(side * length, (corner & 2 ? 0.5 : -0.5) * width, 0.0);
      const int row = 3 * int(p.contacts.size());
      for (int axis = 0; axis < 3; ++axis)
      {
        const Vector3d direction = turn.col((axis + 2) % 3);
        jacobian.row(row + axis) << direction.transpose(), point.cross(direction).transpose();
      }
      p.contacts.push_back({ row, 2.0 * side * tilt - depth, stiffness, 0.25, ratio, friction });
    }
  }
  p.delassus = jacobian * axes * inverse.asDiagonal() * axes.transpose() * jacobian.transpose();
  p.velocity = std::pow(10.0, -5.5 + 4.0 * random.uniform()) * jacobian * gaussian(6, 1);
  return p;
}

TEST(ContactSolver, FulfilsComplementarityAndTheFrictionCone)
{
  phri_core::Random random(5);
  Met met;
  for (int trial = 0; trial < 600; ++trial)
    expectConditions(randomProblem(random, 3, 0.6), met);
  EXPECT_EQ(met.unconverged, 0);
  EXPECT_GT(met.sticking, 50);
  EXPECT_GT(met.sliding, 50);
  EXPECT_GT(met.apart, 50);
}

TEST(ContactSolver, FulfilsThemOnRedundantFlatContactsOfOneBody)
{
  phri_core::Random random(19);
  for (const int patches : { 1, 2 })
  {
    Met met;
    for (int trial = 0; trial < 3000; ++trial)
      expectConditions(randomPatches(random, patches), met);
    EXPECT_EQ(met.unconverged, 0) << patches;
    EXPECT_GT(met.sticking, 100);
    EXPECT_GT(met.sliding, 500);
    EXPECT_GT(met.apart, 500);
  }
}

/// Friction as rigid as it gets: plain Gauss-Seidel, twenty thousand sweeps, written here once more. What it and the
/// solver may share in any way among redundant points, they agree on for the body.
TEST(ContactSolver, MovesTheBodyAsLongGaussSeidelDoes)
{
  phri_core::Random random(23);
  for (int trial = 0; trial < 100; ++trial)
  {
    const Problem p = randomPatches(random, 1);
    Eigen::VectorXd impulses(12), slow = Eigen::VectorXd::Zero(12);
    ContactSolver solver(12);
    ASSERT_LE(solver.solve(kStep, p.delassus, p.contacts, p.velocity, impulses), ContactSolver::kMaxSweeps);
    Eigen::VectorXd velocity = p.velocity;
    const auto move = [&](int row, double by) {
      slow(row) += by;
      velocity += by * p.delassus.col(row);
    };
    for (int sweep = 0; sweep < 200000; ++sweep)
    {
      for (const CompliantContact& c : p.contacts)
      {
        double bias, softness;
        normalRow(p, c, bias, softness);
        const double excess = velocity(c.row) + bias + softness * slow(c.row);
        move(c.row, std::max(-slow(c.row), -excess / (p.delassus(c.row, c.row) + softness)));
        const double trace = p.delassus.block<2, 2>(c.row + 1, c.row + 1).trace();
        const Eigen::Vector2d old = slow.segment<2>(c.row + 1);
        Eigen::Vector2d next = old - (velocity.segment<2>(c.row + 1) + ContactSolver::kCreep * trace * old) / trace;
        const double limit = c.friction * slow(c.row);
        if (next.norm() > limit)
          next *= limit / next.norm();
        move(c.row + 1, next.x() - old.x());
        move(c.row + 2, next.y() - old.y());
      }
    }
    const double scale = (p.delassus * slow).cwiseAbs().maxCoeff() + p.velocity.cwiseAbs().maxCoeff();
    EXPECT_LT((p.delassus * (impulses - slow)).cwiseAbs().maxCoeff(), kCrawled * scale) << trial;
  }
}
}  // namespace
