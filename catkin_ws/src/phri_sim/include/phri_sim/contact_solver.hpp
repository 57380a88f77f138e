#pragma once
#include <Eigen/Core>
#include <vector>

namespace phri_sim
{
/// One compliant unilateral contact. Its rows are `row` (normal) and, with friction > 0, row + 1 and row + 2
/// (orthogonal tangents).
struct CompliantContact
{
  int row = 0;
  double distance = 0.0;       ///< phi [m] before the step, negative in penetration
  double stiffness = 2e4;      ///< K of the pair [N/m, Nm/rad]
  double share = 1.0;          ///< of K and of the damping that acts at this point
  double damping_ratio = 0.1;  ///< [-]
  double friction = 0.0;       ///< Coulomb's mu; 0: no tangent rows
};

/// Impulses of compliant contacts over one step h, implicit in both spring and damper (velocity and penetration at the
/// end of the step), which is stable at any stiffness:
///   lambda_n >= 0, complementary to  u_n + phi K / (h K + D) + lambda_n / (h (h K + D)) >= 0   (K, D times share)
///   |lambda_t| <= mu lambda_n (cone), u_t + s_t lambda_t = 0 below, lambda_t against u_t + s_t lambda_t on the cone
/// with u = u_free + A lambda, A = J M^-1 J^T, D = 2 ratio sqrt(K / A_nn); D = 0 while phi > 0: nothing damps before it
/// touches. At rest lambda_n / h = -K phi exactly. s_t = kCreep x trace(A_tt): friction that sticks creeps, by
/// 2 kCreep of what its force would accelerate a free point in one step (50 N on 1 kg: 1e-5 m/s). That shares the load
/// between redundant points (the face of a box has four), and without it nothing below finds all solutions.
///
/// Projected Gauss-Seidel by blocks (normal, then tangents together) solves one or two points in a few sweeps, but
/// crawls where points share one rigid body, or its effective masses differ much. Then, from what the sweeps found,
/// Newton's method on the same conditions, written as projections (Alart and Curnier 1991), with an LU of the pressing
/// rows. Where it does not end, because points flip between sticking and sliding, it starts again with a thousandfold
/// s_t, which it takes back in as many steps as it needs. Bullet's two solvers do not fit: both bound each tangent
/// alone (a pyramid), and allocate when sizes change. No allocation after construction.
class ContactSolver
{
public:
  static constexpr int kMaxSweeps = 200;       ///< and Newton's steps, together
  static constexpr double kTolerance = 1e-10;  ///< largest change (of Newton: residual) over largest impulse [-]
  static constexpr double kCreep = 1e-4;       ///< [-]

  explicit ContactSolver(int max_rows);

  /// `free_velocity` are the rows' velocities after a step without contacts. Writes `impulses` [Ns] (its values before
  /// the call do not matter). Returns the sweeps and steps taken; more than kMaxSweeps if not converged: the impulses
  /// are then those of the last sweep, inside the cone.
  int solve(double h, const Eigen::Ref<const Eigen::MatrixXd>& delassus, const std::vector<CompliantContact>& contacts,
            const Eigen::Ref<const Eigen::VectorXd>& free_velocity, Eigen::Ref<Eigen::VectorXd> impulses) noexcept;

private:
  struct Block  // a contact, ready to be solved
  {
    int row;
    double friction, bias, softness, creep;
    double normal_mass, tangent_mass;  // how far a projection steps: about the inverse of A's diagonal
    Eigen::Matrix2d stop;              // impulse that stops the tangents
  };
  using Matrix = Eigen::Ref<const Eigen::MatrixXd>;
  using Vector = Eigen::Ref<Eigen::VectorXd>;
  using ConstVector = Eigen::Ref<const Eigen::VectorXd>;

  void setUp(double h, const Matrix& delassus, const std::vector<CompliantContact>& contacts) noexcept;
  bool sweep(const Matrix& delassus, Vector impulses) noexcept;
  bool newton(const Matrix& delassus, const ConstVector& free_velocity, double softening, int most,
              int& steps) noexcept;
  bool stiffen(const Matrix& delassus, const ConstVector& free_velocity, int& steps) noexcept;
  double open(const Matrix& delassus) noexcept;
  double lineariseNormal(const Matrix& delassus, const Block& block, int at) noexcept;
  double lineariseTangents(const Matrix& delassus, const Block& block, double softening, int at) noexcept;
  bool solveLinear() noexcept;
  void enterCone() noexcept;

  std::vector<Block> blocks_;
  std::size_t used_ = 0;
  Eigen::VectorXd velocity_, trial_, solved_, residual_;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian_;
  std::vector<int> pressing_;  // row of each unknown of Newton's step
  int size_ = 0;               // their number
};
}  // namespace phri_sim
