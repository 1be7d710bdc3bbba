//! Which adapter draws, and what went wrong with it.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use wgpu::{Adapter, Backends, Device, DeviceType, Limits, Queue};

use crate::render::GpuChoice;

/// Why no picture comes from a graphics card; the processor makes the same ones.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// It was switched off.
    #[error("the graphics card is switched off (NEIF_GPU=off)")]
    SwitchedOff,
    /// There is none.
    #[error("no graphics card was found")]
    NoAdapter,
    /// There is one that cannot be used, or not for this scene, or no longer: its name and what is wrong.
    #[error("{0}")]
    Unusable(String),
}

/// An open device, and the first thing that went wrong with it.
pub(super) struct Gpu {
    pub(super) device: Device,
    pub(super) queue: Queue,
    pub(super) name: String,
    fault: Arc<Mutex<Option<GpuError>>>,
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gpu")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

impl Gpu {
    /// Opens the best adapter that the choice allows; takes up to seconds.
    pub(super) fn open(choice: GpuChoice) -> Result<Self, GpuError> {
        if choice == GpuChoice::Off {
            return Err(GpuError::SwitchedOff);
        }
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = pollster::block_on(instance.enumerate_adapters(Backends::PRIMARY));
        let kinds: Vec<DeviceType> = adapters
            .iter()
            .map(|adapter| adapter.get_info().device_type)
            .collect();
        let adapter =
            best(&kinds, choice)
                .map(|i| &adapters[i])
                .ok_or_else(|| match adapters.first() {
                    Some(adapter) => {
                        let name = adapter.get_info().name;
                        GpuError::Unusable(format!("`{name}` runs on the processor"))
                    }
                    None => GpuError::NoAdapter,
                })?;
        Self::of(adapter)
    }

    fn of(adapter: &Adapter) -> Result<Self, GpuError> {
        let name = adapter.get_info().name;
        let required_limits = limits(&name, &adapter.limits())?;
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("neif preview"),
            required_limits,
            ..Default::default()
        });
        let unusable = |error| GpuError::Unusable(format!("`{name}` cannot be used: {error}"));
        let (device, queue) = pollster::block_on(request).map_err(unusable)?;
        let fault = Arc::new(Mutex::new(None));
        let (first, adapter) = (Arc::clone(&fault), name.clone());
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let what = match error {
                wgpu::Error::OutOfMemory { .. } => format!("`{adapter}` is out of memory"),
                wgpu::Error::Validation { description, .. }
                | wgpu::Error::Internal { description, .. } => {
                    format!("`{adapter}` failed: {description}")
                }
            };
            note(&first, GpuError::Unusable(what));
        }));
        let (first, adapter) = (Arc::clone(&fault), name.clone());
        device.set_device_lost_callback(move |_, reason| {
            note(&first, lost(&adapter, reason));
        });
        Ok(Self {
            device,
            queue,
            name,
            fault,
        })
    }

    /// What went wrong so far.
    pub(super) fn check(&self) -> Result<(), GpuError> {
        let fault = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
        fault.clone().map_or(Ok(()), Err)
    }

    /// Bytes that one table may have.
    pub(super) fn most_bytes(&self) -> u64 {
        let limits = self.device.limits();
        limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size)
    }

    /// An error of this device.
    pub(super) fn lost(&self, reason: impl fmt::Display) -> GpuError {
        lost(&self.name, reason)
    }
}

/// It was there and is gone: removed, reset, or out of power.
fn lost(adapter: &str, reason: impl fmt::Display) -> GpuError {
    GpuError::Unusable(format!("`{adapter}` was lost: {reason}"))
}

/// Keeps the first error: what follows from it explains less.
fn note(fault: &Mutex<Option<GpuError>>, error: GpuError) {
    let mut fault = fault.lock().unwrap_or_else(PoisonError::into_inner);
    fault.get_or_insert(error);
}

/// The adapter to use, of their kinds.
fn best(kinds: &[DeviceType], choice: GpuChoice) -> Option<usize> {
    let rank = |kind: DeviceType| match kind {
        DeviceType::DiscreteGpu => Some(0),
        DeviceType::IntegratedGpu => Some(1),
        DeviceType::VirtualGpu => Some(2),
        DeviceType::Other | DeviceType::Cpu => (choice == GpuChoice::On).then_some(3),
    };
    let ranked = kinds.iter().enumerate();
    ranked
        .filter_map(|(i, kind)| Some((rank(*kind)?, i)))
        .min()
        .map(|(_, i)| i)
}

/// What is asked of a device: what every one should have, and tables as large as it allows.
fn limits(adapter: &str, has: &Limits) -> Result<Limits, GpuError> {
    let needed = Limits::defaults();
    let mut lacking = None;
    needed.check_limits_with_fail_fn(has, true, |limit, needs, has| {
        lacking = Some(GpuError::Unusable(format!(
            "`{adapter}` can do too little: {limit} is {has}, and {needs} is needed"
        )));
    });
    lacking.map_or(
        Ok(Limits {
            max_storage_buffer_binding_size: has.max_storage_buffer_binding_size,
            max_buffer_size: has.max_buffer_size,
            ..needed
        }),
        Err,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_real_adapter_goes_before_software_which_must_be_asked_for() {
        use DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, VirtualGpu};
        assert_eq!(
            best(&[Cpu, IntegratedGpu, DiscreteGpu], GpuChoice::Auto),
            Some(2)
        );
        assert_eq!(best(&[VirtualGpu, Cpu], GpuChoice::On), Some(0));
        assert_eq!(best(&[Cpu], GpuChoice::Auto), None);
        assert_eq!(best(&[Cpu], GpuChoice::On), Some(0));
        assert_eq!(best(&[], GpuChoice::On), None);
    }

    #[test]
    fn a_lacking_limit_is_named() {
        let weak = Limits {
            max_storage_buffers_per_shader_stage: 4,
            ..Limits::defaults()
        };
        let error = limits("Old Card", &weak).unwrap_err().to_string();
        assert!(
            error.contains("Old Card") && error.contains("max_storage_buffers_per_shader_stage"),
            "{error}"
        );
        assert!(limits("New Card", &Limits::defaults()).is_ok());
    }
}
