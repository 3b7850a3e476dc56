//! Environment that a launcher, such as `mpirun` or a batch system, gives to each process.

/// Place of a process in the job of its launcher.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Launched {
    /// Number of this process in the job, from 0.
    pub rank: usize,
    /// Number of processes in the job.
    pub ranks: usize,
}

/// Variables of launchers: number of the process, and number of processes in the job. In this order: Open
/// MPI; MPICH and its derivatives; `srun --mpi=pmix`.
const VARIABLES: [(&str, &[&str]); 3] = [
    ("OMPI_COMM_WORLD_RANK", &["OMPI_COMM_WORLD_SIZE"]),
    ("PMI_RANK", &["PMI_SIZE", "SLURM_STEP_NUM_TASKS", "SLURM_NTASKS"]),
    ("PMIX_RANK", &["SLURM_STEP_NUM_TASKS", "SLURM_NTASKS"]),
];

impl Launched {
    /// Reads the environment of this process; `None` if no launcher started it.
    ///
    /// Slurm sets the number of tasks in every process of a job. It only counts beside a rank that a launcher
    /// set.
    pub fn from_environment() -> Option<Self> {
        Self::from_variables(&|name| std::env::var(name).ok())
    }

    fn from_variables(variable: &dyn Fn(&str) -> Option<String>) -> Option<Self> {
        // A variable that holds no number counts as not set.
        let number = |name: &str| variable(name)?.trim().parse::<usize>().ok();
        // Both or none: Slurm sets the number of tasks where no launcher has set a rank, too.
        VARIABLES.iter().find_map(|(rank, sizes)| {
            let ranks = sizes.iter().find_map(|name| number(name))?;
            Some(Self {
                rank: number(rank)?,
                ranks,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Launched;

    #[test]
    fn launchers_tell_ranks_in_their_own_words() {
        let read = |variables: &[(&str, &str)]| {
            let variable = |name: &str| variables.iter().find(|v| v.0 == name).map(|v| v.1.to_owned());
            Launched::from_variables(&variable)
        };
        let some = |rank, ranks| Some(Launched { rank, ranks });
        assert_eq!(read(&[]), None);
        assert_eq!(
            read(&[("OMPI_COMM_WORLD_RANK", "2"), ("OMPI_COMM_WORLD_SIZE", "4")]),
            some(2, 4)
        );
        assert_eq!(read(&[("PMI_RANK", "0"), ("PMI_SIZE", "3")]), some(0, 3));
        // srun --mpi=pmix
        assert_eq!(read(&[("PMIX_RANK", "1"), ("SLURM_NTASKS", "8")]), some(1, 8));
        // Open MPI's mpirun in a Slurm job with more tasks.
        let variables = [
            ("PMIX_RANK", "1"),
            ("SLURM_NTASKS", "8"),
            ("OMPI_COMM_WORLD_RANK", "1"),
            ("OMPI_COMM_WORLD_SIZE", "2"),
        ];
        assert_eq!(read(&variables), some(1, 2));
        // A batch job whose script starts the program directly.
        assert_eq!(read(&[("SLURM_NTASKS", "8")]), None);
        assert_eq!(
            read(&[("OMPI_COMM_WORLD_RANK", "x"), ("OMPI_COMM_WORLD_SIZE", "4")]),
            None
        );
    }
}
